//! Benches of the hot stages of a bake and of a frame, on the Cornell box at preset `Draft`. All
//! stages run on one thread, so that figures of machines with different numbers of cores are
//! comparable.
//!
//! | bench | work of one iteration |
//! |---|---|
//! | `bvh_cast` | nearest hit of gather rays |
//! | `bvh_transmittance` | shadow rays through the BVH of the frame |
//! | `grid_look_up` | functions near positions, from the hashed grid |
//! | `basis_look_up` | weights of the senders' functions at positions |
//! | `gather_point` | one row |
//! | `cut_row` | truncation of one gathered row |
//! | `pack` | all rows of the operator |
//! | `read_bake` | bytes of a `.mgi` file to a validated scene |
//! | `project` | one light at all senders, with shadows |
//! | `apply` | all links of the operator |
//! | `flatten` | all points without a row, at tier 1 |
//! | `splat_pixel` | all pixels of a small view |

mod bake_stages;
mod fixture;
mod frame_stages;

use criterion::Criterion;
use fixture::Fixture;

fn main() {
    let set_up = rayon::ThreadPoolBuilder::new().build().expect("threads");
    let fixture = set_up.install(Fixture::new);
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()
        .expect("the global pool is not built yet");
    let mut criterion = Criterion::default().configure_from_args();
    bake_stages::bench(&mut criterion, &fixture);
    frame_stages::bench(&mut criterion, &fixture);
    criterion.final_summary();
}
