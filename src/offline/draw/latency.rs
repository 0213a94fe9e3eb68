//! Where the time of the periods went: one line per share, how many cycles took how long, both axes
//! logarithmic. For the terminal the same as bars.
//!
//! Invariant: the same shares give the same bytes.

use std::fmt::Write;

use super::chart::{BELOW, LEFT, legend};
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::{GRID, SOFT_INK, text};
use crate::log::timing::{BINS, Share, bin_start_us};

/// Bars for the terminal, `width` characters at most, their length the logarithm of the count.
pub fn bars(share: &Share, width: usize) -> String {
    let mut out = format!("{}\n", share.name);
    let Some(used) = share.used() else { return out + "  no cycle\n" };
    let most = share.bins.iter().copied().max().unwrap_or(1).max(1);
    for bin in used {
        let count = share.bins[bin];
        let length = (count as f64 + 1.0).ln() / (most as f64 + 1.0).ln() * width.saturating_sub(24) as f64;
        let bar = "█".repeat(length.round() as usize);
        let bar = if count > 0 && bar.is_empty() { "▏".to_owned() } else { bar };
        let _infallible = writeln!(out, "{:>9} us {count:>9}  {bar}", rounded(bin_start_us(bin)));
    }
    out
}

/// Two significant digits.
fn rounded(us: f64) -> String {
    let decimals = (1.0 - us.log10().floor()).clamp(0.0, 3.0) as usize;
    format!("{us:.decimals$}")
}

const SIZE: [f64; 2] = [760.0, 420.0];
const COLOURS: [&str; 4] = ["#0b5394", "#e08a00", "#2a7f3f", "#1a1a1a"];

/// All shares on one sheet.
pub fn sheet(title: &str, shares: &[Share]) -> String {
    let mut svg = Svg::new(SIZE[0], SIZE[1]);
    let corner = [LEFT + 10.0, 64.0];
    let size = [SIZE[0] - corner[0] - 24.0, SIZE[1] - corner[1] - BELOW - 8.0];
    let most = shares.iter().flat_map(|share| &share.bins).copied().max().unwrap_or(1);
    let decades_y = (most.max(1) as f64).log10().ceil().max(1.0);
    let x = |bin: f64| corner[0] + bin / BINS as f64 * size[0];
    // An empty bin lies on the floor, half a decade below a single cycle.
    let y = |count: u64| {
        let decades = if count == 0 { -0.5 } else { (count as f64).log10() };
        corner[1] + size[1] * (1.0 - (decades + 0.5) / (decades_y + 0.5))
    };
    let soft = |anchor| TextStyle { colour: SOFT_INK, ..text(11.0, anchor) };
    const DECADES: [&str; 8] = ["0.1 us", "1 us", "10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s"];
    for (decade, label) in DECADES.into_iter().enumerate() {
        let place = x((decade * BINS / (DECADES.len() - 1)) as f64);
        svg.line([place, corner[1]], [place, corner[1] + size[1]], Stroke::solid(GRID, 0.7));
        svg.text([place, corner[1] + size[1] + 14.0], soft(Anchor::Middle), label);
    }
    for decade in 0..=decades_y as u32 {
        let place = y(10_u64.pow(decade));
        svg.line([corner[0], place], [corner[0] + size[0], place], Stroke::solid(GRID, 0.7));
        svg.text([corner[0] - 6.0, place + 4.0], soft(Anchor::End), &10_u64.pow(decade).to_string());
    }
    let mut entries = Vec::new();
    for (share, colour) in shares.iter().zip(COLOURS) {
        let stroke = Stroke::solid(colour, 1.6);
        let Some(used) = share.used() else { continue };
        let (first, last) = (*used.start(), *used.end());
        let mut points = vec![[x(first as f64), y(0)]];
        for bin in used {
            points.extend([[x(bin as f64), y(share.bins[bin])], [x(bin as f64 + 1.0), y(share.bins[bin])]]);
        }
        points.push([x(last as f64 + 1.0), y(0)]);
        svg.polyline(&points, stroke);
        entries.push((share.name.clone(), stroke));
    }
    svg.frame(corner, size, Stroke::solid(SOFT_INK, 0.8));
    let bold = TextStyle { is_bold: true, ..text(13.5, Anchor::Middle) };
    svg.text([SIZE[0] / 2.0, 22.0], bold, title);
    legend(&mut svg, [SIZE[0] / 2.0, 46.0], &entries);
    svg.text([corner[0] + size[0] / 2.0, corner[1] + size[1] + 31.0], soft(Anchor::Middle), "time");
    svg.text_upwards([20.0, corner[1] + size[1] / 2.0], soft(Anchor::Middle), "cycles");
    svg.finish(title)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::timing::Timings;

    fn share(name: &str, times: &[(u64, u64)]) -> Share {
        let mut histogram = Timings::default().wake;
        for (ns, count) in times {
            histogram.saturating_record_n(*ns, *count);
        }
        Share::of(name, &histogram)
    }

    #[test]
    fn the_longest_bar_fills_the_width_and_a_single_cycle_is_seen() {
        let share = share("total", &[(10_001, 1_000_000), (5_000_000, 1)]);
        let text = bars(&share, 80);
        let lengths: Vec<usize> = text.lines().map(|line| line.matches('█').count()).collect();
        assert_eq!(lengths.iter().max(), Some(&56));
        let last = text.lines().last().expect("a line for the last bin");
        assert!(last.contains(" 1  █") || last.contains(" 1  ▏"), "{last}");
        assert!(text.contains("10 us   1000000"), "{text}");
    }

    #[test]
    fn a_sheet_shows_each_share_that_has_cycles() {
        let shares = [share("collect", &[(10_000, 5)]), share("total", &[])];
        let sheet = sheet("a run", &shares);
        assert!(sheet.contains("collect") && !sheet.contains(">total<") && sheet.contains("a run"));
    }
}
