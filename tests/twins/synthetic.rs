//! A scene that no bake would make: hundreds of points on five levels with random rows, so that every branch of every kernel runs. Everything follows from
//! a counter, so it is the same on every machine.

#[path = "by_hand.rs"]
mod by_hand;

use bevy_meshless_gi::asset::{BakeInfo, BakedScene, Display, Places, PointSurface};
use bevy_meshless_gi::basis::{WeightEntry, Weights, support_bounds};
use bevy_meshless_gi::frame::FrameLight;
use bevy_meshless_gi::samples::{HashedGrid, LitPlace, Point};
use bevy_meshless_gi::scene::{Bvh, BvhNode, BvhTriangle, Light};
use bevy_meshless_gi::transport::pca::{Column, Compression};
use bevy_meshless_gi::transport::{BounceLink, BounceOperator, Link, Operator, Row, SenderForm};
use by_hand::operator;
use glam::{IVec3, Vec3};

/// Counted random numbers in [0, 1).
pub struct Dice(i32);

impl Dice {
    pub fn new(seed: i32) -> Self {
        Self(seed * 1_000_003)
    }

    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(1);
        (HashedGrid::hash(IVec3::new(self.0, 77, -5)) >> 8) as f32 / (1 << 24) as f32
    }

    pub fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    pub fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f32) as usize).min(n - 1)
    }

    pub fn vec(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    pub fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.vec();
            if v.length_squared() > 0.01 && v.length_squared() < 1.0 {
                return v.normalize();
            }
        }
    }

    pub fn colour(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit())
    }
}

/// Where the levels start: five levels, the first three send.
const LEVELS: [u32; 6] = [0, 16, 60, 150, 330, 701];
const SENDER_LEVELS: u32 = 3;
/// Places of each sender of the third.
const PLACES: u32 = 6;

/// The scene.
pub fn scene(form: SenderForm) -> BakedScene {
    let mut dice = Dice::new(1);
    let count = LEVELS[5] as usize;
    let senders = LEVELS[SENDER_LEVELS as usize] as usize;
    let level_of = |i: usize| (0..5).rev().find(|&l| LEVELS[l] as usize <= i).unwrap();

    let mut planes = Vec::new();
    let points: Vec<Point> = (0..count)
        .map(|i| {
            let x = 2.0 * dice.vec();
            let mut p = Point::new(x, dice.direction(), 0.7 + 0.3 * dice.unit());
            let here = i % 4;
            p.planes = planes.len() as u32 | (here as u32) << 24;
            for _ in 0..here {
                // A plane that leaves the centre on its right side.
                let m = dice.direction();
                let plane = m.extend(0.2 + 0.3 * dice.unit() - m.dot(x));
                // Every third one is an occluder's, and leans.
                let lean = if planes.len() % 3 == 0 { 0.3f32 } else { 0.0 };
                planes.push((plane * (1.0 + lean).sqrt()).to_array());
            }
            p
        })
        .collect();
    let surfaces = (0..count)
        .map(|i| PointSurface {
            albedo: (0.9 * dice.colour()).to_array(),
            emission: (if i % 5 == 0 {
                0.2 * dice.colour()
            } else {
                Vec3::ZERO
            })
            .to_array(),
            sky: (0.5 * dice.vec()).to_array(),
            ..PointSurface::default()
        })
        .collect();

    let row = |dice: &mut Dice, range: std::ops::Range<usize>| {
        let n = 1 + dice.below(5);
        let mut entries: Vec<_> = (0..n)
            .map(|_| WeightEntry {
                index: (range.start + dice.below(range.len())) as u32,
                weight: 0.1 + dice.unit(),
            })
            .collect();
        let sum: f32 = entries.iter().map(|e| e.weight).sum();
        entries.iter_mut().for_each(|e| e.weight /= sum);
        entries
    };
    let level = |l: usize| LEVELS[l] as usize..LEVELS[l + 1] as usize;
    // Some senders keep their own sample.
    let pull = Weights::from_rows((0..senders).map(|k| {
        if k % 7 == 3 || level_of(k) == 2 {
            Vec::new()
        } else {
            row(&mut dice, level(level_of(k) + 1))
        }
    }));
    let parents = Weights::from_rows((0..count).map(|i| match (level_of(i), form) {
        (0, _) => Vec::new(),
        (l, SenderForm::Averages | SenderForm::Components) => row(&mut dice, level(l - 1)),
        (l, SenderForm::Differences) => (0..l).flat_map(|k| row(&mut dice, level(k))).collect(),
    }));

    let compression = (form == SenderForm::Components).then(|| {
        let own = (0..senders).filter(|&k| pull.row(k).is_empty());
        columns(&mut dice, own.map(|k| k as u32).collect(), senders)
    });
    let coefficients = compression
        .as_ref()
        .map_or(senders, Compression::components);
    let mut rows = Vec::new();
    let mut links = Vec::new();
    for i in 0..count {
        // The coarsest have rows, of the others every second; one row is empty, one is long.
        let active = level_of(i) == 0 || i % 2 == 0;
        let n = match i {
            _ if !active => 0,
            10 => 0,
            20 => coefficients + 1,
            _ => 1 + dice.below(400),
        };
        let scale = 0.002 + 0.01 * dice.unit();
        rows.push(Row {
            start: links.len() as u32,
            count: n as u32,
            scale,
            tier: match active {
                false => 0,
                true if form.rows_stand_alone() && level_of(i) > 0 => 1 + (i as u32 / 2) % 4,
                true => 1,
            },
        });
        for k in 0..n {
            let sender = if i == 20 {
                k
            } else {
                dice.below(coefficients + 1)
            };
            links.push(Link::pack(scale * dice.vec(), scale, sender as u16));
        }
    }
    let bounces = BounceOperator {
        starts: (0..=LEVELS[1]).map(|k| 9 * k).collect(),
        links: (0..9 * LEVELS[1])
            .map(|_| BounceLink {
                gain: (0.05 * dice.colour()).to_array(),
                sender: dice.below(senders) as u32,
            })
            .collect(),
        bounces: 3,
    };
    let grid = HashedGrid::build(count, 0.7, |i| support_bounds(&points[i]));
    BakedScene {
        points,
        surfaces,
        level_starts: LEVELS.to_vec(),
        sender_levels: SENDER_LEVELS,
        places: Places {
            per_sender: PLACES,
            list: (0..PLACES * (LEVELS[3] - LEVELS[2]))
                .map(|_| LitPlace::new(2.0 * dice.vec(), dice.direction()))
                .collect(),
        },
        pull,
        parents,
        operator: Operator {
            compression,
            ..operator(form, rows, &links)
        },
        visibility: None,
        probes: None,
        occluders: None,
        fmm: None,
        illumination: Vec::new(),
        sky: None,
        materials: None,
        bounces: Some(bounces),
        display: Display {
            radius: 0.85,
            planes,
            grid,
        },
        bvh: bvh(&mut dice),
        info: BakeInfo {
            bounds: [[-3.0; 3], [3.0; 3]],
            ..BakeInfo::default()
        },
    }
}

/// Columns of clusters of one sender, two, seven and more; the sky's behind them.
fn columns(dice: &mut Dice, own: Vec<u32>, senders: usize) -> Compression {
    let mut out = Compression::default();
    let sizes = [1, 2, 7, 30, usize::MAX];
    let mut at = 0;
    for size in sizes {
        let count = size.min(own.len() - at);
        at += count;
        for _ in 0..5 {
            out.columns.push(Column {
                member: (at - count) as u32,
                count: count as u32,
                value: out.values.len() as u32,
                scale: 0.1 + 0.2 * dice.unit(),
            });
            let words = (0..count.div_ceil(2)).map(|_| Link::pack(dice.vec(), 1.0, 0).xy);
            out.values.extend(words);
        }
    }
    out.members = own;
    out.columns.push(Column {
        member: out.members.len() as u32,
        count: 1,
        value: out.values.len() as u32,
        scale: 1.0,
    });
    out.members.push(senders as u32);
    // A half of one.
    out.values.push(0x3c00);
    out
}

/// Light slots of every kind: a point, a spot, a sun, a free slot, a rectangle, and a point light with a short range.
pub fn lights() -> Vec<FrameLight> {
    let mut lights = Vec::new();
    let all = [
        Light::Point {
            position: Vec3::new(0.3, 0.4, -0.2),
            intensity: Vec3::new(3.0, 2.0, 1.0),
            range: f32::INFINITY,
        },
        Light::Spot {
            position: Vec3::new(-1.3, 1.4, 0.2),
            direction: Vec3::new(0.5, -0.7, 0.1),
            intensity: Vec3::new(5.0, 6.0, 7.0),
            inner: 0.4,
            outer: 0.9,
            range: 8.0,
        },
        Light::Directional {
            direction: Vec3::new(-0.2, -1.0, 0.3),
            irradiance: Vec3::new(2.0, 1.9, 1.7),
        },
        Light::Rect {
            center: Vec3::new(0.0, 2.2, 0.0),
            u: Vec3::new(0.5, 0.0, 0.1),
            v: Vec3::new(0.0, 0.0, 0.4),
            radiance: Vec3::new(4.0, 5.0, 4.0),
        },
        Light::Point {
            position: Vec3::new(1.5, -0.4, 1.2),
            intensity: Vec3::splat(2.0),
            range: 1.5,
        },
    ];
    for (i, light) in all.iter().enumerate() {
        lights.extend(FrameLight::expand(light, 4));
        if i == 2 {
            lights.push(FrameLight::default());
        }
    }
    lights
}

/// A few hundred random triangles under a BVH of median splits.
fn bvh(dice: &mut Dice) -> Bvh {
    let mut triangles: Vec<BvhTriangle> = (0..300)
        .map(|_| {
            let a = 2.5 * dice.vec();
            BvhTriangle {
                a: a.to_array(),
                b: (a + 0.4 * dice.vec()).to_array(),
                c: (a + 0.4 * dice.vec()).to_array(),
                ..BvhTriangle::default()
            }
        })
        .collect();
    let mut out = Bvh {
        nodes: vec![BvhNode::default()],
        triangles: Vec::new(),
    };
    split(&mut out, 0, &mut triangles);
    out
}

fn split(out: &mut Bvh, node: usize, triangles: &mut [BvhTriangle]) {
    let corners = |t: &BvhTriangle| [t.a, t.b, t.c].map(Vec3::from_array);
    let all = || triangles.iter().flat_map(corners);
    let min = all().fold(Vec3::INFINITY, Vec3::min) - 1e-4;
    let max = all().fold(Vec3::NEG_INFINITY, Vec3::max) + 1e-4;
    if triangles.len() <= 4 {
        out.nodes[node] = BvhNode {
            min: min.to_array(),
            first: out.triangles.len() as u32,
            max: max.to_array(),
            count: triangles.len() as u32,
        };
        out.triangles.extend_from_slice(triangles);
        return;
    }
    let first = out.nodes.len();
    out.nodes.extend([BvhNode::default(); 2]);
    out.nodes[node] = BvhNode {
        min: min.to_array(),
        first: first as u32,
        max: max.to_array(),
        count: 0,
    };
    let axis = (max - min).max_position();
    triangles.sort_by(|s, t| s.a[axis].total_cmp(&t.a[axis]));
    let (left, right) = triangles.split_at_mut(triangles.len() / 2);
    split(out, first, left);
    split(out, first + 1, right);
}
