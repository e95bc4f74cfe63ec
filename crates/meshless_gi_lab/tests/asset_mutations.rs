//! A million seeded mutations of `.mgi` files: reading never panics, never takes more memory than
//! allowed, and every accepted file runs a frame. `MGI_TEST_INTENSITY` (default 1) scales the
//! number.

mod support;

use glam::Vec3;
use meshless_gi::internals::frame::soft_shadow::{self, SoftLight};
use meshless_gi::{
    AssetError, BakedScene, CpuFrame, FrameLight, FrameSettings, Limits, MaterialFactors,
};
use rayon::prelude::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicU64, Ordering};
use support::{Random, build, makes};

/// Allocator that counts the allocated bytes of each thread.
struct Counting;

thread_local! {
    static NOW: Cell<i64> = const { Cell::new(0) };
    static PEAK: Cell<i64> = const { Cell::new(0) };
}

fn count(bytes: i64) {
    let now = NOW.get() + bytes;
    NOW.set(now);
    PEAK.set(PEAK.get().max(now));
}

// SAFETY: forwards every call to the system's allocator, and only counts in thread-local cells that
// need no allocation.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as i64);
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both may be alive while it moves.
        count(size as i64);
        count(-(layout.size() as i64));
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        count(-(layout.size() as i64));
        unsafe { System.dealloc(old, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Returns the peak of the allocations of `run` on this thread, bytes.
fn peak<T>(run: impl FnOnce() -> T) -> (T, i64) {
    let before = NOW.get();
    PEAK.set(before);
    let out = run();
    (out, PEAK.get() - before)
}

/// Section of a file, split by this test's own implementation of docs/FORMAT.md.
#[derive(Clone)]
struct FileSection {
    row: [u8; 40],
    body: Vec<u8>,
}

impl FileSection {
    fn field(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.row[at..at + 8].try_into().unwrap())
    }

    fn raw(&self) -> Vec<u8> {
        if self.row[6] == 0 {
            self.body.clone()
        } else {
            lz4_flex::block::decompress(&self.body, self.field(24) as usize).unwrap()
        }
    }

    /// Other content, with lengths that fit.
    fn set_raw(&mut self, raw: &[u8], items: u64) {
        self.body = lz4_flex::block::compress(raw);
        self.row[6] = 1;
        self.row[8..16].copy_from_slice(&items.to_le_bytes());
        self.row[24..32].copy_from_slice(&(raw.len() as u64).to_le_bytes());
    }
}

fn split_sections(file: &[u8]) -> Vec<FileSection> {
    let count = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let mut at = 32 + 40 * count;
    (0..count)
        .map(|i| {
            let row: [u8; 40] = file[32 + 40 * i..72 + 40 * i].try_into().unwrap();
            let stored = u64::from_le_bytes(row[16..24].try_into().unwrap()) as usize;
            at += stored;
            FileSection {
                row,
                body: file[at - stored..at].to_vec(),
            }
        })
        .collect()
}

/// Puts parts together with sound lengths and checksums.
fn join_sections(parts: &[FileSection]) -> Vec<u8> {
    let mut file = b"\x89MGI\r\n\x1a\n".to_vec();
    file.extend(3u32.to_le_bytes());
    file.extend((parts.len() as u32).to_le_bytes());
    let length = 32 + parts.iter().map(|p| 40 + p.body.len()).sum::<usize>();
    file.extend((length as u64).to_le_bytes());
    file.extend([0; 8]);
    for part in parts {
        let mut row = part.row;
        row[16..24].copy_from_slice(&(part.body.len() as u64).to_le_bytes());
        row[32..36].copy_from_slice(&crc32fast::hash(&part.body).to_le_bytes());
        file.extend(row);
    }
    for part in parts {
        file.extend(&part.body);
    }
    fix_header(&mut file);
    file
}

/// Makes the header's checksum right, if there is a header.
fn fix_header(file: &mut [u8]) {
    if file.len() < 32 {
        return;
    }
    let count = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
    let end = count.saturating_mul(40).saturating_add(32).min(file.len());
    file[24..28].fill(0);
    let crc = crc32fast::hash(&file[..end]);
    file[24..28].copy_from_slice(&crc.to_le_bytes());
}

/// Values at limits, which often cause errors.
const BOUNDARY_VALUES: [u64; 14] = [
    0,
    1,
    2,
    0x7f,
    0xff,
    0xffff,
    0x7c00,
    0x7f80_0000,
    0x7fc0_0000,
    0x8000_0000,
    0xffff_ffff,
    1 << 32,
    1 << 40,
    u64::MAX,
];

fn corrupt(bytes: &mut [u8], r: &mut Random) {
    for _ in 0..=r.below(3) {
        let at = r.below(bytes.len());
        if bytes.is_empty() {
            return;
        }
        match r.below(4) {
            0 => bytes[at] ^= 1 << r.below(8),
            1 => bytes[at] = r.next() as u8,
            2 => {
                let value = BOUNDARY_VALUES[r.below(BOUNDARY_VALUES.len())].to_le_bytes();
                let width = [1, 2, 4, 8][r.below(4)].min(bytes.len() - at);
                bytes[at..at + width].copy_from_slice(&value[..width]);
            }
            _ => {
                let (to, length) = (r.below(bytes.len()), 1 + r.below(16));
                let length = length.min(bytes.len() - at.max(to));
                bytes.copy_within(at..at + length, to);
            }
        }
    }
}

struct Seed {
    file: Vec<u8>,
    parts: Vec<FileSection>,
}

fn mutate(seeds: &[Seed], r: &mut Random) -> Vec<u8> {
    let seed = &seeds[r.below(seeds.len())];
    let other = &seeds[r.below(seeds.len())];
    let mut file = seed.file.clone();
    let mut parts = seed.parts.clone();
    let (pick, from) = (r.below(parts.len()), r.below(other.parts.len()));
    match r.below(10) {
        0 => corrupt(&mut file, r),
        1 => {
            file.truncate(r.below(file.len()));
            if r.below(2) == 0 && file.len() > 24 {
                let length = file.len() as u64;
                file[16..24].copy_from_slice(&length.to_le_bytes());
                fix_header(&mut file);
            }
        }
        2 => {
            // Lengths and counts, with a sound checksum.
            let rows = parts.len();
            let at = match r.below(4) {
                0 => 8 + 4 * r.below(6),
                _ => 32 + 40 * r.below(rows) + [0, 4, 8, 16, 24, 32][r.below(6)],
            };
            let value = if r.below(2) == 0 {
                BOUNDARY_VALUES[r.below(BOUNDARY_VALUES.len())]
            } else {
                r.next() >> r.below(64)
            };
            let width = [4, 8][r.below(2)].min(file.len() - at);
            file[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
            fix_header(&mut file);
        }
        3 => {
            let with = r.below(parts.len());
            if r.below(2) == 0 {
                parts.swap(pick, with);
            } else {
                let body = parts[with].body.clone();
                parts[pick].body = body;
            }
            return join_sections(&parts);
        }
        4 => {
            // A splice of two files.
            let at = r.below(file.len());
            let behind = r.below(other.file.len());
            file.truncate(at);
            file.extend(&other.file[behind..]);
            if r.below(2) == 0 {
                fix_header(&mut file);
            }
        }
        5 => {
            parts[pick] = other.parts[from].clone();
            if r.below(2) == 0 {
                parts[pick].row[..4].copy_from_slice(&seed.parts[pick].row[..4]);
            }
            return join_sections(&parts);
        }
        6 => {
            // A damaged stream under a sound checksum.
            corrupt(&mut parts[pick].body, r);
            return join_sections(&parts);
        }
        7 => {
            // More or fewer items.
            let mut raw = parts[pick].raw();
            let items = parts[pick].field(8) as usize;
            let size = raw.len().checked_div(items).unwrap_or(4);
            let changed = match r.below(3) {
                0 => items + 1 + r.below(5),
                1 => r.below(items),
                _ => items * (1 + r.below(200)),
            };
            raw.resize(changed * size, r.next() as u8);
            parts[pick].set_raw(&raw, changed as u64);
            if r.below(4) == 0 {
                parts.remove(r.below(parts.len()));
            }
            return join_sections(&parts);
        }
        _ => {
            // Other values, everything else sound: this reaches the semantic checks.
            let mut raw = parts[pick].raw();
            let items = parts[pick].field(8);
            corrupt(&mut raw, r);
            parts[pick].set_raw(&raw, items);
            return join_sections(&parts);
        }
    }
    file
}

/// A frame with every kernel on it.
fn walk(scene: &BakedScene) -> Vec3 {
    let mut frame = CpuFrame::new(scene);
    frame.set_lights(
        scene,
        &[FrameLight::point(
            Vec3::new(0.2, 0.9, 0.1),
            Vec3::ONE,
            f32::INFINITY,
        )],
    );
    let soft_light = SoftLight::sphere(Vec3::new(0.2, 0.9, 0.1), 0.1, Vec3::ONE, 5.0, 4);
    let mut sum = match scene.data().visibility {
        Some(_) => soft_shadow::occluded_irradiances(scene.data(), &[soft_light])
            .iter()
            .map(|d| d.dot(Vec3::Y))
            .sum(),
        None => Vec3::ZERO,
    };
    let painted = MaterialFactors {
        base_color: [1.0; 3],
        emissive: [2.0; 3],
    };
    frame.set_materials(scene, &[painted; 2]);
    frame.set_occluders(scene, &[0.5, 0.0]);
    for baked_bounces in [false, true] {
        frame.solve(
            scene,
            &FrameSettings {
                sweeps: 1,
                baked_bounces,
                sky: Vec3::ONE.into(),
                emission: 1.0,
                tier: 1,
                ..FrameSettings::default()
            },
        );
        for p in scene.data().points.iter().take(4) {
            sum += frame.irradiance(scene, p.x(), p.n()).unwrap_or_default();
        }
        sum += frame
            .irradiance(scene, Vec3::new(1e9, -0.0, -1e-30), Vec3::Y)
            .unwrap_or_default();
    }
    sum
}

fn seeds() -> Vec<Seed> {
    makes()
        .iter()
        .map(|make| {
            let file = build(make).to_bytes().unwrap();
            Seed {
                parts: split_sections(&file),
                file,
            }
        })
        .collect()
}

#[test]
fn mutated_assets_are_rejected_or_harmless() {
    const LIMIT: u64 = 1 << 20;
    let intensity: f64 = std::env::var("MGI_TEST_INTENSITY")
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(1.0);
    let total = (1_000_000.0 * intensity) as u64;
    let seeds = seeds();
    for seed in &seeds {
        assert_eq!(
            join_sections(&seed.parts),
            seed.file,
            "this test reads the format as it is written"
        );
        assert!(BakedScene::from_bytes(&seed.file, &Limits { max_bytes: LIMIT }).is_ok());
    }
    let limits = Limits { max_bytes: LIMIT };
    let outcomes: [AtomicU64; 8] = Default::default();
    let worst = AtomicU64::new(0);
    (0..total).into_par_iter().for_each(|i| {
        let file = mutate(&seeds, &mut Random(i));
        let (read, taken) = peak(|| BakedScene::from_bytes(&file, &limits));
        assert!(taken <= LIMIT as i64, "mutation {i}: {taken} bytes");
        worst.fetch_max(taken as u64, Ordering::Relaxed);
        let outcome = match read {
            Ok(scene) => {
                assert!(scene.validate().is_ok(), "mutation {i}");
                walk(&scene);
                0
            }
            Err(AssetError::NotMgi | AssetError::Version { .. }) => 1,
            Err(AssetError::Truncated { .. }) => 2,
            Err(AssetError::Header { .. }) => 3,
            Err(AssetError::Checksum { .. }) => 4,
            Err(AssetError::Section { .. }) => 5,
            Err(AssetError::Limit { .. }) => 6,
            Err(AssetError::Invalid(_)) => 7,
            Err(e) => panic!("mutation {i}: {e}"),
        };
        outcomes[outcome].fetch_add(1, Ordering::Relaxed);
    });
    let outcomes = outcomes.map(AtomicU64::into_inner);
    println!(
        "{total} mutations: valid {}, magic {}, truncated {}, header {}, checksum {}, section {}, limit {}, invalid {}; most memory {} bytes",
        outcomes[0],
        outcomes[1],
        outcomes[2],
        outcomes[3],
        outcomes[4],
        outcomes[5],
        outcomes[6],
        outcomes[7],
        worst.into_inner()
    );
    // Every check is reached, the deep ones often.
    if total >= 100_000 {
        assert!(outcomes.iter().all(|&n| n > total / 5000), "{outcomes:?}");
        assert!(
            outcomes[7] > total / 50 && outcomes[0] > total / 50,
            "{outcomes:?}"
        );
    }
}

/// Must fail: the harness detects excess memory, and a walk over a scene that validation rejects
/// fails.
#[test]
fn mutation_harness_detects_memory_and_index_errors() {
    let (_, taken) = peak(|| std::hint::black_box(vec![1u8; 3 << 20]).len());
    assert!(taken >= 3 << 20);
    let mut scene = build(&makes()[0]);
    walk(&scene);
    let first = scene.data().operator.rows[0].start as usize;
    scene.data_mut().operator.links[first].z_sender |= 0xffff_0000;
    assert!(scene.validate().is_err());
    assert!(std::panic::catch_unwind(|| walk(&scene)).is_err());
}
