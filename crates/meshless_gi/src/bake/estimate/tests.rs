//! Tests of `estimate`.

use super::summary::student;
use super::*;

fn source(square: f64, noise: f64, returns: f64) -> LightError {
    LightError {
        square,
        noise,
        returns,
    }
}

#[test]
fn student_quantiles_match_tables() {
    for (freedom, q) in [(5.0, 2.5706), (10.0, 2.2281), (30.0, 2.0423), (1e9, 1.9600)] {
        assert!((student(freedom) / q - 1.0).abs() < 0.02, "{freedom}");
    }
}

#[test]
fn interval_differing_lights_is_wide_and_noise_is_narrow() {
    let alike = summarize(&[source(0.01, 0.0, 1.0); 20]);
    assert!(
        (alike.nrmse - 0.1).abs() < 1e-6 && alike.interval < 1e-6,
        "{alike:?}"
    );
    let differ = |noise| -> Vec<LightError> {
        let squares = (0..20).map(|k| if k % 2 == 0 { 0.005 } else { 0.015 });
        squares.map(|square| source(square, noise, 1.0)).collect()
    };
    let (wide, known) = (summarize(&differ(0.0)), summarize(&differ(1.0)));
    assert!(
        (wide.nrmse - 0.1).abs() < 1e-6 && (0.03..0.06).contains(&wide.interval),
        "{wide:?}"
    );
    assert!(known.interval < 0.4 * wide.interval, "{known:?}");
    // Lights with almost no returned light have almost no weight.
    let mut sources = vec![source(0.01, 0.0, 1.0); 20];
    sources.push(source(1.0, 0.0, 1e-5));
    assert!((summarize(&sources).nrmse - 0.1).abs() < 1e-3);
    assert_eq!(summarize(&[]), ErrorEstimate::default());
    let one = summarize(&[source(0.01, 0.0, 1.0)]);
    assert_eq!(one.nrmse, one.interval);
}

#[test]
fn importance_draws_match_scores() {
    let scores: Vec<f64> = (0..100).map(|k| if k < 50 { 0.5 } else { 1.5 }).collect();
    let mut random = Random::new(1, 2, 3);
    let drawn = systematic(&scores, 40, &mut random);
    assert_eq!(drawn.len(), 40);
    let low = drawn.iter().filter(|&&i| i < 50).count();
    assert!((9..=11).contains(&low) && drawn.is_sorted(), "{drawn:?}");
}
