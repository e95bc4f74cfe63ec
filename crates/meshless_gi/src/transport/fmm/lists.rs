//! The four interaction lists of the adaptive method (\[G08\] §3).
//!
//! | list | source | receiver | evaluation |
//! |---|---|---|---|
//! | far | node | node | S→R |
//! | local | points of a leaf | node | R-expansion of each source |
//! | multipole | node | points of a leaf | evaluation of the S-expansion |
//! | near | points of a leaf | points of a leaf | kernel |
//!
//! \[G08\] §2.5 builds them from neighborhoods of cells. Here pairs of nodes are divided from the
//! root down until a list accepts the pair. This handles nodes of all sizes and directions. Two
//! nodes interact by expansions if they are well separated and all their points face each other
//! ([`super::facing`]) and are mutually visible ([`super::visibility`]). The cheapest of the
//! allowed lists gets the pair. Each pair of a source and a receiver is in exactly one list or
//! exchanges no light.

use super::facing::{Facing, any_light, boxes_face_away, facing};
use super::settings::{FmmError, FmmSettings};
use super::terms::count;
use super::tree::{COINCIDENT, Tree, TreeNode};
use super::visibility::Visibility;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;

/// Source of a node. 8 bytes, `FmmEntry` in the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ListEntry {
    /// Node of the source.
    pub source: u32,
    /// Unoccluded fraction of its light: 1 if nothing occludes it.
    pub weight: f32,
}

/// One list of every node.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct List {
    /// Start of each node's entries, and the end of the last.
    pub starts: Vec<u32>,
    /// The entries.
    pub entries: Vec<ListEntry>,
}

impl List {
    /// Returns the entries of one node.
    #[must_use]
    pub fn entries_of(&self, node: usize) -> &[ListEntry] {
        &self.entries[self.starts[node] as usize..self.starts[node + 1] as usize]
    }

    fn new(nodes: usize, found: impl Iterator<Item = (u32, ListEntry)> + Clone) -> Self {
        let mut starts = vec![0u32; nodes + 1];
        for (receiver, _) in found.clone() {
            starts[receiver as usize + 1] += 1;
        }
        for i in 0..nodes {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut entries = vec![ListEntry::default(); starts[nodes] as usize];
        for (receiver, entry) in found {
            let at = &mut next[receiver as usize];
            entries[*at as usize] = entry;
            *at += 1;
        }
        Self { starts, entries }
    }
}

/// The four lists and the counts of their construction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lists {
    /// Source node to receiver node, S→R.
    pub far: List,
    /// Points of a leaf to a node.
    pub local: List,
    /// A node to points of a leaf.
    pub multipole: List,
    /// Points to points.
    pub near: List,
    /// Counts of the construction.
    pub counts: ListCounts,
}

/// Counts of the construction of lists.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ListCounts {
    /// Visited pairs of nodes.
    pub visited: u64,
    /// Pairs that face away from each other.
    pub away: u64,
    /// Pairs that are well separated, but of which only a part faces each other.
    pub mixed: u64,
    /// Pairs that are fully occluded.
    pub hidden: u64,
    /// Pairs in the lists that are partially occluded.
    pub partial: u64,
    /// Pairs of points in the near list.
    pub point_pairs: u64,
    /// Rays between points.
    pub rays: u64,
}

impl ListCounts {
    fn add(&mut self, other: &Self) {
        self.visited += other.visited;
        self.away += other.away;
        self.mixed += other.mixed;
        self.hidden += other.hidden;
        self.partial += other.partial;
        self.point_pairs += other.point_pairs;
        self.rays += other.rays;
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum ListKind {
    Far,
    Local,
    Multipole,
    Near,
}

#[derive(Default)]
struct InteractionLists {
    entries: Vec<(ListKind, u32, ListEntry)>,
    counts: ListCounts,
}

/// Receiver and source.
type Pair = (u32, u32);

/// Number of pairs from which on they are distributed to threads.
const MIN_PARALLEL_PAIRS: usize = 1024;

struct Search<'a> {
    tree: &'a Tree,
    settings: &'a FmmSettings,
    visibility: Option<Visibility<'a>>,
    /// Cost of S→R and of one point with an expansion, in products of a derivative and a term.
    s_to_r: f64,
    point: f64,
}

/// Cost of a pair of points in such products.
const POINT_PAIR: f64 = 0.5;

/// Builds all lists. Without `visibility` nothing is occluded.
///
/// # Errors
/// [`FmmError::TooManyPairs`].
pub fn lists(
    tree: &Tree,
    settings: &FmmSettings,
    visibility: Option<Visibility<'_>>,
) -> Result<Lists, FmmError> {
    let p = settings.order;
    let products: f64 = (1..=6).map(|k| (p + k) as f64 / k as f64).product();
    let search = Search {
        tree,
        settings,
        visibility,
        s_to_r: products + 3.0 * count(p) as f64,
        point: 2.0 * count(p) as f64,
    };
    let mut parts = vec![InteractionLists::default()];
    let mut pairs: Vec<Pair> = match tree.nodes.is_empty() {
        true => Vec::new(),
        false => vec![(0, 0)],
    };
    while !pairs.is_empty() && pairs.len() < MIN_PARALLEL_PAIRS {
        let mut below = Vec::new();
        for &pair in &pairs {
            search.step(pair, &mut parts[0], &mut below);
        }
        pairs = below;
    }
    let found: Vec<InteractionLists> = pairs
        .par_iter()
        .map(|&pair| {
            let mut found = InteractionLists::default();
            let mut stack = vec![pair];
            while let Some(pair) = stack.pop() {
                search.step(pair, &mut found, &mut stack);
            }
            found
        })
        .collect();
    parts.extend(found);
    // The four lists become one array.
    let entries = parts.iter().map(|part| part.entries.len() as u64).sum();
    if entries > u64::from(u32::MAX) {
        return Err(FmmError::TooManyPairs(entries));
    }
    let of = |kind: ListKind| {
        let all = parts.iter().flat_map(|part| &part.entries);
        List::new(
            tree.nodes.len(),
            all.filter(move |e| e.0 == kind).map(|e| (e.1, e.2)),
        )
    };
    let mut counts = ListCounts::default();
    parts.iter().for_each(|part| counts.add(&part.counts));
    Ok(Lists {
        far: of(ListKind::Far),
        local: of(ListKind::Local),
        multipole: of(ListKind::Multipole),
        near: of(ListKind::Near),
        counts,
    })
}

impl Search<'_> {
    /// Adds a pair to a list, drops it, or divides it into pairs that are added to `below`.
    fn step(&self, (t, s): Pair, out: &mut InteractionLists, below: &mut Vec<Pair>) {
        let tree = self.tree;
        let (nt, ns) = (&tree.nodes[t as usize], &tree.nodes[s as usize]);
        if nt.receivers == 0 || ns.sources == 0 {
            return;
        }
        out.counts.visited += 1;
        let distance = nt.center.distance(ns.center);
        // Coincident points exchange no light, and a node with one normal does not light its own
        // plane.
        if distance + nt.radius + ns.radius <= COINCIDENT || boxes_face_away(nt, ns) {
            out.counts.away += 1;
            return;
        }
        let leaves = nt.is_leaf() && ns.is_leaf();
        if let Some(kind) = self.cheapest(nt, ns, distance) {
            match facing(tree, t as usize, s as usize, self.settings.slack.into()) {
                Facing::Away => {
                    out.counts.away += 1;
                    return;
                }
                Facing::Front => {
                    let small =
                        nt.radius + ns.radius <= f64::from(self.settings.penumbra) * distance;
                    if self.take(kind, (t, s), leaves || small, out) {
                        return;
                    }
                }
                Facing::Mixed => out.counts.mixed += 1,
            }
        }
        if leaves {
            if any_light(tree, t as usize, s as usize) {
                self.take(ListKind::Near, (t, s), true, out);
            } else {
                out.counts.away += 1;
            }
            return;
        }
        // The larger of the two is divided. The spread of its normals counts as size.
        let extent = |n: &TreeNode| n.radius + n.spread * distance.min(1.0);
        if ns.is_leaf() || (!nt.is_leaf() && extent(nt) >= extent(ns)) {
            below.extend(nt.child_range().map(|c| (c as u32, s)));
        } else {
            below.extend(ns.child_range().map(|c| (t, c as u32)));
        }
    }

    /// Returns the cheapest list that the distances of the pair allow.
    fn cheapest(&self, nt: &TreeNode, ns: &TreeNode, distance: f64) -> Option<ListKind> {
        let limit = f64::from(self.settings.separation);
        let (lt, ls) = (f64::from(nt.receivers), f64::from(ns.sources));
        let apart = nt.radius + ns.radius <= limit * distance;
        let beside = |center: DVec3, radius: f64, n: &TreeNode| {
            let gap = center.distance(center.clamp(n.min, n.max));
            gap > COINCIDENT && radius <= limit * gap
        };
        let options = [
            (ListKind::Far, self.s_to_r, apart),
            (
                ListKind::Multipole,
                lt * self.point,
                nt.is_leaf() && (apart || beside(ns.center, ns.radius, nt)),
            ),
            (
                ListKind::Local,
                ls * self.point,
                ns.is_leaf() && (apart || beside(nt.center, nt.radius, ns)),
            ),
        ];
        let direct = POINT_PAIR * lt * ls;
        let allowed = options.into_iter().filter(|o| o.2);
        let best = allowed.min_by(|a, b| a.1.total_cmp(&b.1))?;
        // A pair of leaves goes to the near list if that is cheaper. Other pairs are not divided
        // for this reason, unless only one side may be expanded.
        let cheaper = direct < best.1;
        match nt.is_leaf() && ns.is_leaf() {
            true if cheaper => None,
            false if cheaper && !apart => None,
            _ => Some(best.0),
        }
    }

    /// Adds a pair to a list, or drops it if it is fully occluded. Returns `false` if partial
    /// occlusion requires a division.
    fn take(&self, kind: ListKind, (t, s): Pair, whole: bool, out: &mut InteractionLists) -> bool {
        let mut weight = 1.0;
        if let Some(visibility) = &self.visibility {
            let (part, rays) = visibility.visible_fraction(self.tree, t as usize, s as usize);
            out.counts.rays += rays;
            if part <= 0.0 {
                out.counts.hidden += 1;
                return true;
            }
            if part < 1.0 {
                if !whole {
                    return false;
                }
                out.counts.partial += 1;
            }
            weight = part;
        }
        if kind == ListKind::Near {
            let nodes = &self.tree.nodes;
            out.counts.point_pairs +=
                u64::from(nodes[t as usize].receivers) * u64::from(nodes[s as usize].sources);
        }
        let entry = ListEntry { source: s, weight };
        out.entries.push((kind, t, entry));
        true
    }
}
