//! Comparison of a kernel's output with the output of its twin.

use bytemuck::NoUninit;

/// Tolerance of single precision, with sums in another order and fused multiplications.
pub const SINGLE: f32 = 1e-5;
/// Tolerance of values stored as halves.
pub const HALF: f32 = 1e-3;

/// Reference quantity of relative errors.
#[derive(Clone, Copy, Debug)]
pub enum Scale {
    /// Largest float of the item. Suits sums of terms of one sign.
    Item,
    /// Larger of the item and the RMS of all items. Suits sums that may cancel.
    Rms,
    /// Larger of each float of an item and a tenth of the RMS of all items.
    Float,
}

/// Returns the items of `width` floats that differ by more than `tolerance`, relative to `scale` of
/// the larger one, or that are not finite. Panics if the comparison would not report a single wrong
/// item of the list.
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
        Scale::Float => 0.1 * rms,
    };
    // Reference value of a float of an item.
    let size = |item: &[f32], float: f32| match scale {
        Scale::Float => float.abs(),
        Scale::Item | Scale::Rms => largest(item),
    };
    reported(gpu.len() / width, |wrong| {
        let mut cpu = cpu.to_vec();
        if let Some(item) = wrong {
            let item = &mut cpu[item * width..(item + 1) * width];
            item[width - 1] += 4.0 * tolerance * size(item, item[width - 1]).max(floor);
        }
        let items = gpu.chunks(width).zip(cpu.chunks(width)).enumerate();
        items
            .filter(|(_, (g, c))| {
                // Written so that a NaN differs.
                !g.iter().zip(*c).all(|(&x, &y)| {
                    (x - y).abs() <= tolerance * size(g, x).max(size(c, y)).max(floor)
                })
            })
            .map(|(i, _)| i)
            .collect()
    })
}

/// Returns the items, of `count`, that a comparison reports in ascending order. `differing` gets
/// the index of an item to make wrong. The first, the middle and the last item are wrong in turn.
/// Panics if the comparison does not report exactly that additional item.
pub fn reported(count: usize, differing: impl Fn(Option<usize>) -> Vec<usize>) -> Vec<usize> {
    let found = differing(None);
    let last = count - 1;
    for item in [0, last / 2, last] {
        if found.contains(&item) {
            continue;
        }
        let mut expected = found.clone();
        expected.push(item);
        expected.sort_unstable();
        let reported = differing(Some(item));
        assert_eq!(
            reported, expected,
            "one wrong item, {item}, is not reported"
        );
    }
    found
}

fn largest(item: &[f32]) -> f32 {
    item.iter().fold(0.0, |a, v| a.max(v.abs()))
}

/// Asserts that all items agree, and that `perturbed`, the twin's output for a slightly different
/// input, differs.
pub fn same<T: NoUninit>(
    name: &str,
    gpu: &[T],
    cpu: &[T],
    perturbed: &[T],
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
        !differing(gpu, perturbed, width, SINGLE, scale).is_empty(),
        "{name}: the comparison does not detect a wrong input"
    );
}
