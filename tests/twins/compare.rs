//! Comparison of a kernel's output with its twin's.

use bytemuck::NoUninit;

/// Single precision: sums in another order, fused multiplications.
pub const SINGLE: f32 = 1e-5;
/// Values stored as halves.
pub const HALF: f32 = 1e-3;

/// Quantity that errors are relative to.
#[derive(Clone, Copy, Debug)]
pub enum Scale {
    /// The item itself: sums of terms of one sign.
    Item,
    /// The item, or the RMS of all where that is more: sums that may cancel.
    Rms,
}

/// Items of `width` floats that differ by more than `tolerance`, relative to the larger item's
/// largest float. Also those that are not finite. Panics where the comparison would not report a
/// single wrong item of the list.
pub fn differing<T: NoUninit>(
    gpu: &[T],
    cpu: &[T],
    width: usize,
    tolerance: f32,
    scale: Scale,
) -> Vec<usize> {
    let (gpu, cpu): (&[f32], &[f32]) = (bytemuck::cast_slice(gpu), bytemuck::cast_slice(cpu));
    assert_eq!(gpu.len(), cpu.len(), "nothing to compare");
    assert!(!gpu.is_empty() && gpu.len() % width == 0);
    let rms = (cpu.iter().map(|v| v * v).sum::<f32>() / cpu.len() as f32).sqrt();
    assert!(rms > 0.0, "the twin's output is black");
    let floor = match scale {
        Scale::Item => f32::MIN_POSITIVE,
        Scale::Rms => rms,
    };
    let found = beyond(gpu, cpu, width, tolerance, floor);
    let last = gpu.len() / width - 1;
    for item in [0, last / 2, last] {
        if found.contains(&item) {
            continue;
        }
        let mut spoiled = cpu.to_vec();
        let wrong = &mut spoiled[item * width..(item + 1) * width];
        wrong[width - 1] += 4.0 * tolerance * largest(wrong).max(floor);
        let mut expected = found.clone();
        expected.push(item);
        expected.sort_unstable();
        assert_eq!(
            beyond(gpu, &spoiled, width, tolerance, floor),
            expected,
            "one wrong item, {item}, is not reported"
        );
    }
    found
}

fn largest(item: &[f32]) -> f32 {
    item.iter().fold(0.0, |a, v| a.max(v.abs()))
}

/// Items that differ by more than `tolerance` of the larger of the item and `floor`.
fn beyond(gpu: &[f32], cpu: &[f32], width: usize, tolerance: f32, floor: f32) -> Vec<usize> {
    let items = gpu.chunks(width).zip(cpu.chunks(width)).enumerate();
    items
        .filter(|(_, (g, c))| {
            let allowed = tolerance * largest(g).max(largest(c)).max(floor);
            // Written so that a NaN differs.
            !g.iter().zip(*c).all(|(g, c)| (g - c).abs() <= allowed)
        })
        .map(|(i, _)| i)
        .collect()
}

/// Asserts that all items agree, and that `spoiled`, the twin's output for a slightly different
/// input, does not.
pub fn same<T: NoUninit>(
    name: &str,
    gpu: &[T],
    cpu: &[T],
    spoiled: &[T],
    width: usize,
    scale: Scale,
) {
    let found = differing(gpu, cpu, width, SINGLE, scale);
    let floats =
        |v: &[T], i: usize| bytemuck::cast_slice::<T, f32>(v)[i * width..(i + 1) * width].to_vec();
    if let Some(&i) = found.first() {
        panic!(
            "{name}: {} items differ, the first is {i}: GPU {:?}, CPU {:?}",
            found.len(),
            floats(gpu, i),
            floats(cpu, i)
        );
    }
    assert!(
        !differing(gpu, spoiled, width, SINGLE, scale).is_empty(),
        "{name}: the comparison does not notice a wrong input"
    );
}
