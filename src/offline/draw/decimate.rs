//! Fewer points for the same picture: files stay small, spikes stay whole.
//!
//! Two steps: of each bin of neighbouring points the least and the greatest survive, in their order;
//! then points that lie within a tolerance of the line through their neighbours go.
//! Invariant: the first and last point and every extreme survive; no point is moved.

/// The least and greatest `height` of each of `bins` bins of the points, in order, with both ends.
pub fn extremes(points: &[[f64; 2]], bins: usize, height: impl Fn([f64; 2]) -> f64) -> Vec<[f64; 2]> {
    let size = points.len().div_ceil(bins.max(1));
    if size <= 2 {
        return points.to_vec();
    }
    let mut kept = Vec::with_capacity(2 * bins + 2);
    for (index, bin) in points.chunks(size).enumerate() {
        let (mut low, mut high) = (0, 0);
        for (at, point) in bin.iter().enumerate() {
            if height(*point) < height(bin[low]) {
                low = at;
            }
            if height(*point) > height(bin[high]) {
                high = at;
            }
        }
        if index == 0 && low.min(high) > 0 {
            kept.push(bin[0]);
        }
        kept.push(bin[low.min(high)]);
        if low != high {
            kept.push(bin[low.max(high)]);
        }
    }
    if let (Some(last), Some(end)) = (kept.last(), points.last())
        && last != end
    {
        kept.push(*end);
    }
    kept
}

/// At most `count_max` points: simplified with the tolerance, doubled until the points are few enough.
/// Smooth lines keep the fine tolerance, only noise is drawn coarser.
pub fn limited(points: &[[f64; 2]], tolerance: f64, count_max: usize) -> Vec<[f64; 2]> {
    let mut kept = simplified(points, tolerance);
    let mut coarser = tolerance;
    while kept.len() > count_max.max(2) {
        coarser *= 2.0;
        kept = simplified(&kept, coarser);
    }
    kept
}

/// Without the points that lie closer than `tolerance` to the line that remains (Ramer, Douglas, Peucker).
pub fn simplified(points: &[[f64; 2]], tolerance: f64) -> Vec<[f64; 2]> {
    if points.len() < 3 {
        return points.to_vec();
    }
    let mut is_kept = vec![false; points.len()];
    (is_kept[0], is_kept[points.len() - 1]) = (true, true);
    let mut open = vec![(0, points.len() - 1)];
    while let Some((from, to)) = open.pop() {
        let farthest = (from + 1..to)
            .map(|at| (distance_to_line(points[at], points[from], points[to]), at))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((distance, at)) = farthest
            && distance > tolerance
        {
            is_kept[at] = true;
            open.extend([(from, at), (at, to)]);
        }
    }
    points.iter().zip(is_kept).filter_map(|(point, kept)| kept.then_some(*point)).collect()
}

/// From a point to the piece of line between two others.
fn distance_to_line(point: [f64; 2], from: [f64; 2], to: [f64; 2]) -> f64 {
    let along = [to[0] - from[0], to[1] - from[1]];
    let off = [point[0] - from[0], point[1] - from[1]];
    let squared = along[0] * along[0] + along[1] * along[1];
    let share =
        if squared > 0.0 { ((off[0] * along[0] + off[1] * along[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (off[0] - share * along[0]).hypot(off[1] - share * along[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_drawn_coarser_until_it_is_small_enough() {
        let points: Vec<[f64; 2]> = (0..3000).map(|i| [f64::from(i), f64::from(i * 7919 % 101)]).collect();
        let few = limited(&points, 0.1, 400);
        assert!((2..=400).contains(&few.len()), "{} points left", few.len());
    }

    #[test]
    fn a_spike_of_one_sample_survives_both_steps() {
        let wave = |i: usize| if i == 54_321 { 40.0 } else { (i as f64 * 1e-4).sin() };
        let points: Vec<[f64; 2]> = (0..120_000).map(|i| [i as f64 * 0.01, wave(i)]).collect();
        let few = simplified(&extremes(&points, 600, |p| p[1]), 0.1);
        assert!(few.len() < 100, "{} points left", few.len());
        assert!(few.contains(&[543.21, 40.0]));
        assert_eq!((few.first(), few.last()), (points.first(), points.last()));
    }
}
