//! The `.mgi` container: reading returns the written scene, the bytes are the same every time, and
//! files are replaced as a whole or not at all.

use super::support::{build, makes};
use meshless_gi::internals::samples::GridSlot;
use meshless_gi::internals::transport::Link;
use meshless_gi::internals::transport::fmm::{FmmNode, FmmOperator, FmmOperatorPoint};
use meshless_gi::internals::transport::pca::Compression;
use meshless_gi::{AssetError, BakedScene, Limits};

#[test]
fn scenes_round_trip_bitwise() {
    for make in makes() {
        let scene = build(&make);
        let stats = scene.validate().unwrap();
        assert_eq!(stats.links, scene.data().operator.links.len() as u64);
        assert_eq!(stats.points_per_level.len(), make.levels.len());
        let bytes = scene.to_bytes().unwrap();
        let back = BakedScene::from_bytes(&bytes, &Limits::default()).unwrap();
        assert_eq!(back, scene, "seed {}", make.seed);
        assert_eq!(back.to_bytes().unwrap(), bytes);
        // Must fail: the comparison detects one bit.
        let mut other = back.clone();
        other.data_mut().points[0].position[0] =
            f32::from_bits(other.data().points[0].position[0].to_bits() ^ 1);
        assert_ne!(other, scene);
        assert_ne!(other.to_bytes().unwrap(), bytes);
    }
}

#[test]
fn reproducible_grid_is_not_stored() {
    let [plain, stored] = [0, 1].map(|i| build(&makes()[i]));
    let sections = |scene: &BakedScene| scene.to_bytes().unwrap()[12];
    // Two for the baked bounces, two for the grid.
    assert_eq!(sections(&stored), sections(&plain) + 4);
}

/// Breaks a valid scene in one position. Validation must name that position.
#[test]
fn validation_detects_each_broken_field() {
    type Break = fn(&mut BakedScene);
    let breaks: &[(&str, Break)] = &[
        ("points", |s| s.data_mut().points[1].position[2] = f32::NAN),
        ("points", |s| s.data_mut().points[1].normal[0] += 0.5),
        ("points", |s| s.data_mut().points[1].radius = 0.0),
        ("points", |s| s.data_mut().points[1].planes = 4 | 1 << 24),
        ("surfaces", |s| s.data_mut().surfaces[0].albedo[1] = 1.5),
        ("surfaces", |s| {
            s.data_mut().surfaces[0].emission[1] = f32::INFINITY
        }),
        ("surfaces", |s| s.data_mut().surfaces[0].emission[1] = 1e30),
        ("surfaces", |s| s.data_mut().surfaces.truncate(3)),
        ("levels", |s| s.data_mut().level_starts[1] = 100),
        ("levels", |s| s.data_mut().level_starts.clear()),
        ("sender levels", |s| s.data_mut().sender_levels = 0),
        ("sender levels", |s| s.data_mut().sender_levels = 9),
        ("planes", |s| s.data_mut().display.planes[0][3] = f32::NAN),
        ("parents", |s| s.data_mut().parents.entries[0].index = 90),
        ("parents", |s| {
            s.data_mut().parents.entries[0].weight = f32::NAN
        }),
        ("parents", |s| s.data_mut().parents.entries[0].weight = 0.9),
        ("parent rows", |s| {
            *s.data_mut().parents.starts.last_mut().unwrap() += 1
        }),
        ("pull", |s| s.data_mut().pull.entries[0].index = 0),
        ("pull", |s| s.data_mut().pull.entries[0].index = u32::MAX),
        ("pull", |s| s.data_mut().pull.entries[0].weight = -1.0),
        ("pull rows", |s| s.data_mut().pull.starts[1] = 100),
        ("rows", |s| s.data_mut().operator.rows[0].start = 1),
        ("rows", |s| s.data_mut().operator.rows[1].count += 1),
        ("rows", |s| {
            s.data_mut().operator.rows[0].scale = f32::INFINITY
        }),
        // Each link is within its limit, but the links in sum carry more light than exists.
        ("rows", |s| {
            let n = s.data().points[0].n();
            let row = s.data().operator.rows[0];
            let links = row.start as usize..(row.start + row.count) as usize;
            s.data_mut().operator.links[links].fill(Link::pack(n, 1.0, 0));
            s.data_mut().operator.rows[0].scale = 2.0;
        }),
        ("rows", |s| s.data_mut().operator.rows[0].tier = 0),
        // Without parents it cannot be left out.
        ("rows", |s| s.data_mut().operator.rows[0].tier = 2),
        ("rows", |s| {
            s.data_mut().operator.rows.last_mut().unwrap().tier = 17;
        }),
        ("tiers", |s| s.info_mut().tiers[0].links += 1),
        ("tiers", |s| {
            s.info_mut().tiers[0].estimated_nrmse = f32::NAN
        }),
        ("tiers", |s| s.info_mut().tiers.truncate(1)),
        ("links", |s| {
            s.data_mut().operator.links[0].z_sender |= 0xffff_0000
        }),
        ("links", |s| s.data_mut().operator.links[0].xy = 0x7c00),
        ("bounce links", |s| {
            s.data_mut().bounces.as_mut().unwrap().links[0].sender = 8
        }),
        ("bounce rows", |s| {
            s.data_mut().bounces.as_mut().unwrap().starts[1] = 60
        }),
        ("grid", |s| s.data_mut().display.grid.cell_size = 0.0),
        ("grid", |s| {
            s.data_mut()
                .display
                .grid
                .slots
                .iter_mut()
                .for_each(|s| s.start = 0)
        }),
        ("grid", |s| s.data_mut().display.grid.slots.truncate(7)),
        ("grid entries", |s| {
            s.data_mut().display.grid.entries[1] = 17
        }),
        ("grid slots", |s| {
            let slot = s
                .data_mut()
                .display
                .grid
                .slots
                .iter_mut()
                .find(|s| s.start != GridSlot::EMPTY);
            slot.unwrap().start += 1;
        }),
        ("bvh nodes", |s| s.data_mut().bvh.nodes[0].first = 0),
        ("bvh nodes", |s| s.data_mut().bvh.nodes[0].first = 4),
        ("bvh nodes", |s| s.data_mut().bvh.nodes[2].first = 1),
        ("bvh nodes", |s| s.data_mut().bvh.nodes[1].count = 100),
        ("bvh nodes", |s| s.data_mut().bvh.nodes[1].min[0] = f32::NAN),
        ("bvh", |s| s.data_mut().bvh.nodes.clear()),
        ("bvh", |s| s.data_mut().bvh.nodes[1].count = 2),
        ("bvh triangles", |s| {
            s.data_mut().bvh.triangles[0].b[1] = f32::NAN
        }),
    ];
    for (location, broken) in breaks {
        let mut scene = build(&makes()[1]);
        assert!(scene.validate().is_ok());
        broken(&mut scene);
        let found = scene.validate().expect_err(location);
        assert!(
            found.iter().any(|v| v.location == *location),
            "{location}: {found:?}"
        );
        assert!(
            matches!(scene.to_bytes(), Err(AssetError::Invalid(_))),
            "{location}"
        );
    }
}

#[test]
fn validation_detects_broken_octree() {
    type Break = fn(&mut FmmOperator);
    fn leaf(o: &FmmOperator, list: usize) -> usize {
        let found = |n: &FmmNode| n.is_leaf() && !n.lists()[list].is_empty();
        o.nodes.iter().position(found).unwrap()
    }
    let breaks: &[(&str, Break)] = &[
        ("octree", |o| o.order = 17),
        ("octree", |o| o.disks = false),
        ("octree", |o| o.level_starts.clear()),
        ("octree", |o| o.level_starts[1] = 2),
        ("octree", |o| *o.level_starts.last_mut().unwrap() += 1),
        ("octree nodes", |o| o.nodes[0].start = 1),
        ("octree nodes", |o| o.nodes[0].parent = 1),
        ("octree nodes", |o| o.nodes[0].first_child = 2),
        ("octree nodes", |o| o.nodes[0].children = u32::MAX),
        ("octree nodes", |o| o.nodes[1].parent = 1),
        ("octree nodes", |o| o.nodes[1].end += 1),
        ("octree nodes", |o| o.nodes[1].center[0] = f32::NAN),
        ("octree nodes", |o| o.nodes[1].size = 0.0),
        ("octree nodes", |o| {
            let at = leaf(o, 3);
            o.nodes[at].sources = o.nodes[at].end + 1;
        }),
        ("octree nodes", |o| {
            let at = leaf(o, 3);
            o.nodes[at].receivers = u32::MAX;
        }),
        ("octree lists", |o| o.nodes[1].far += 1),
        ("octree entries", |o| o.entries[0].source = 10_000),
        ("octree entries", |o| o.entries[0].weight = f32::NAN),
        ("octree entries", |o| o.entries[0].weight = 1.5),
        ("octree entries", |o| o.entries.truncate(3)),
        // A near entry that is not a leaf, a far one of the node itself.
        ("octree entries", |o| {
            let at = o.nodes[leaf(o, 3)].near as usize;
            o.entries[at].source = 0;
        }),
        ("octree entries", |o| {
            let at = o.nodes.iter().position(|n| n.far < n.local).unwrap();
            let entry = o.nodes[at].far as usize;
            o.entries[entry].source = at as u32;
        }),
        ("octree points", |o| o.points[0].position[1] = 50.0),
        ("octree points", |o| o.points[0].normal = [0.0; 3]),
        ("octree points", |o| o.points[0].share = -1.0),
        ("octree points", |o| o.points[0].factor = f32::INFINITY),
        ("octree points", |o| {
            // Two that receive for one sender.
            let found = |p: &FmmOperatorPoint| p.share == 0.0;
            let first = o.points.iter().position(found).unwrap();
            let last = o.points.iter().rposition(found).unwrap();
            o.points[first].point = o.points[last].point;
        }),
        ("octree points", |o| o.points[0].point = 1000),
        ("octree points", |o| {
            o.points.iter_mut().for_each(|p| p.point += 40)
        }),
    ];
    let good = || build(&makes()[6]);
    let lists = good().data().fmm.clone().unwrap();
    for list in 0..4 {
        let entries: usize = lists.nodes.iter().map(|n| n.lists()[list].len()).sum();
        assert!(entries > 0, "list {list} has no entries");
    }
    for (k, (location, broken)) in breaks.iter().enumerate() {
        let mut scene = good();
        let sound = scene.validate();
        assert!(sound.is_ok(), "{sound:?}");
        broken(scene.data_mut().fmm.as_mut().unwrap());
        let found = match scene.validate() {
            Err(found) => found,
            Ok(_) => panic!("break {k}: {location}"),
        };
        assert!(
            found.iter().any(|v| v.location == *location),
            "break {k}: {location}: {found:?}"
        );
    }
}

#[test]
fn validation_detects_broken_columns() {
    type Break = fn(&mut Compression);
    let breaks: &[(&str, Break)] = &[
        ("columns", |c| c.columns.clear()),
        ("columns", |c| c.columns[1].member = 1),
        ("columns", |c| c.columns[1].member = u32::MAX),
        ("columns", |c| c.columns[0].count = 0),
        ("columns", |c| c.columns[0].count = u32::MAX),
        ("columns", |c| c.columns[1].value = 0),
        ("columns", |c| c.columns[1].value = u32::MAX),
        ("columns", |c| c.columns[1].scale = f32::NAN),
        ("columns", |c| c.columns[1].scale = -0.5),
        ("columns", |c| c.columns[1].scale *= 0.5),
        ("columns", |c| c.columns.truncate(2)),
        ("columns", |c| {
            let sky = *c.columns.last().unwrap();
            c.columns.push(sky);
        }),
        ("column senders", |c| c.members[0] = c.members[1]),
        ("column senders", |c| c.members[0] = 1000),
        ("column senders", |c| *c.members.last_mut().unwrap() = 0),
        ("column senders", |c| c.members.push(0)),
        ("column values", |c| c.values[0] = 0x7c00),
        ("column values", |c| c.values[0] = 0x7e00_3c00),
        ("column values", |c| c.values[0] = 0x4000_0000),
        ("column values", |c| c.values.push(0)),
    ];
    let good = || build(&makes()[5]);
    for (k, (location, broken)) in breaks.iter().enumerate() {
        let mut scene = good();
        assert!(scene.validate().is_ok());
        broken(scene.data_mut().operator.compression.as_mut().unwrap());
        let found = match scene.validate() {
            Err(found) => found,
            Ok(_) => panic!("break {k}: {location}"),
        };
        assert!(
            found.iter().any(|v| v.location == *location),
            "break {k}: {location}: {found:?}"
        );
    }
    let mut scene = good();
    scene.data_mut().operator.compression = None;
    assert!(
        scene
            .validate()
            .unwrap_err()
            .iter()
            .any(|v| v.location == "columns")
    );
    let mut scene = build(&makes()[0]);
    scene.data_mut().operator.compression = good().data().operator.compression.clone();
    assert!(
        scene
            .validate()
            .unwrap_err()
            .iter()
            .any(|v| v.location == "columns")
    );
    let mut scene = good();
    let beyond = scene.data().operator.coefficients(0) + 1;
    let link = &mut scene.data_mut().operator.links[0];
    *link = Link::pack(link.vector(), 1.0, beyond as u16);
    assert!(
        scene
            .validate()
            .unwrap_err()
            .iter()
            .any(|v| v.location == "links")
    );
    let mut scene = good();
    scene
        .data_mut()
        .operator
        .rows
        .iter_mut()
        .for_each(|row| row.scale *= 15.0);
    assert!(
        scene
            .validate()
            .unwrap_err()
            .iter()
            .any(|v| v.location == "rows")
    );
}

#[test]
fn read_errors_name_cause() {
    let good = build(&makes()[0]).to_bytes().unwrap();
    let read = |bytes: &[u8]| BakedScene::from_bytes(bytes, &Limits::default()).unwrap_err();
    assert!(matches!(read(b""), AssetError::NotMgi));
    assert!(matches!(
        read(b"glTF\x02\0\0\0, but no light in it at all"),
        AssetError::NotMgi
    ));
    assert!(matches!(read(&good[..20]), AssetError::Truncated { .. }));
    assert!(matches!(
        read(&good[..good.len() - 1]),
        AssetError::Truncated { .. }
    ));
    let mut longer = good.clone();
    longer.push(0);
    assert!(matches!(read(&longer), AssetError::Header { .. }));
    let mut newer = good.clone();
    newer[8] = 77;
    assert!(matches!(
        read(&newer),
        AssetError::Version { found: 77, .. }
    ));
    let mut flipped = good.clone();
    flipped[40] ^= 1;
    assert!(matches!(
        read(&flipped),
        AssetError::Checksum { section: "header" }
    ));
    let mut flipped = good.clone();
    *flipped.last_mut().unwrap() ^= 1;
    assert!(matches!(
        read(&flipped),
        AssetError::Checksum {
            section: "light samples"
        }
    ));
    let small = Limits { max_bytes: 1000 };
    assert!(matches!(
        BakedScene::from_bytes(&good, &small),
        Err(AssetError::Limit { allowed: 1000, .. })
    ));
}

#[test]
fn files_are_replaced_atomically() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("level.mgi");
    let (a, b) = (build(&makes()[0]), build(&makes()[1]));
    let size = a.write(&path).unwrap();
    assert_eq!(size, std::fs::metadata(&path).unwrap().len());
    assert_eq!(BakedScene::read(&path, &Limits::default()).unwrap(), a);
    b.write(&path).unwrap();
    assert_eq!(BakedScene::read(&path, &Limits::default()).unwrap(), b);
    // A scene that is not valid leaves the file as it is.
    let mut broken = a.clone();
    broken.data_mut().points[0].radius = -1.0;
    assert!(broken.write(&path).unwrap_err().is_content());
    assert_eq!(BakedScene::read(&path, &Limits::default()).unwrap(), b);
    // No temporary file is left behind.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    for unwritable in [
        folder.path().join("no/such/folder.mgi"),
        folder.path().to_owned(),
    ] {
        let error = a.write(&unwritable).unwrap_err();
        assert!(
            matches!(error, AssetError::Io { .. }) && !error.is_content(),
            "{error}"
        );
    }
    let error = BakedScene::read(&folder.path().join("none.mgi"), &Limits::default()).unwrap_err();
    assert!(matches!(&error, AssetError::Io { .. }) && error.to_string().contains("none.mgi"));
    let limits = Limits { max_bytes: 100 };
    assert!(matches!(
        BakedScene::read(&path, &limits),
        Err(AssetError::Limit { .. })
    ));
}
