//! Where the time of the periods went: one line per share, how many cycles took how long, both axes
//! logarithmic. For the terminal the same as bars.
//!
//! Invariant: bins are the same for every share and run, so pictures can be laid side by side.

use std::fmt::Write;

use super::chart::{BELOW, LEFT, legend};
use super::svg::{Anchor, Stroke, Svg, TextStyle};
use super::{GRID, SOFT_INK, text};

/// Bins per factor of ten in time.
const BINS_PER_DECADE: i32 = 10;
/// Shortest time drawn, as a power of ten in seconds: 100 ns; all below is in the first bin.
const FIRST_DECADE: i32 = -7;
/// Longest time drawn: 1 s.
const LAST_DECADE: i32 = 0;

/// Cycles of one share by how long they took.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// Its name.
    pub name: &'static str,
    /// Cycles in each bin, from the shortest time.
    pub cycles: Vec<u64>,
}

impl Share {
    /// From times in nanoseconds with how often each was seen.
    pub fn new(name: &'static str, times: impl Iterator<Item = (u64, u64)>) -> Self {
        let mut cycles = vec![0; ((LAST_DECADE - FIRST_DECADE) * BINS_PER_DECADE) as usize];
        let last = cycles.len() - 1;
        for (ns, count) in times {
            let place =
                ((ns.max(1) as f64 * 1e-9).log10() - f64::from(FIRST_DECADE)) * f64::from(BINS_PER_DECADE);
            cycles[(place.max(0.0) as usize).min(last)] += count;
        }
        Self { name, cycles }
    }

    /// The bins that are not empty, with their lower ends in microseconds.
    fn used(&self) -> Option<std::ops::RangeInclusive<usize>> {
        let first = self.cycles.iter().position(|count| *count > 0)?;
        let last = self.cycles.iter().rposition(|count| *count > 0)?;
        Some(first..=last)
    }
}

/// Lower end of a bin, in microseconds.
fn start_us(bin: usize) -> f64 {
    10_f64.powf(f64::from(FIRST_DECADE) + bin as f64 / f64::from(BINS_PER_DECADE)) * 1e6
}

/// Bars for the terminal, `width` characters at most, their length the logarithm of the count.
pub fn bars(share: &Share, width: usize) -> String {
    let mut out = format!("{}\n", share.name);
    let Some(used) = share.used() else { return out + "  no cycle\n" };
    let most = share.cycles.iter().copied().max().unwrap_or(1).max(1);
    for bin in used {
        let count = share.cycles[bin];
        let length = (count as f64 + 1.0).ln() / (most as f64 + 1.0).ln() * width.saturating_sub(24) as f64;
        let bar = "█".repeat(length.round() as usize);
        let bar = if count > 0 && bar.is_empty() { "▏".to_owned() } else { bar };
        let _infallible = writeln!(out, "{:>9} us {count:>9}  {bar}", rounded(start_us(bin)));
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
    let most = shares.iter().flat_map(|share| &share.cycles).copied().max().unwrap_or(1);
    let decades_y = (most.max(1) as f64).log10().ceil().max(1.0);
    let x = |bin: f64| {
        let bins = f64::from((LAST_DECADE - FIRST_DECADE) * BINS_PER_DECADE);
        corner[0] + bin / bins * size[0]
    };
    // An empty bin lies on the floor, half a decade below a single cycle.
    let y = |count: u64| {
        let decades = if count == 0 { -0.5 } else { (count as f64).log10() };
        corner[1] + size[1] * (1.0 - (decades + 0.5) / (decades_y + 0.5))
    };
    let soft = |anchor| TextStyle { colour: SOFT_INK, ..text(11.0, anchor) };
    for (decade, label) in (0..).zip(["0.1 us", "1 us", "10 us", "100 us", "1 ms", "10 ms", "100 ms", "1 s"])
    {
        let place = x(f64::from(decade * BINS_PER_DECADE));
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
            points
                .extend([[x(bin as f64), y(share.cycles[bin])], [x(bin as f64 + 1.0), y(share.cycles[bin])]]);
        }
        points.push([x(last as f64 + 1.0), y(0)]);
        svg.polyline(&points, stroke);
        entries.push((share.name.to_owned(), stroke));
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

    #[test]
    fn every_cycle_is_in_one_bin_and_the_ends_take_the_rest() {
        let share = Share::new("total", [(0, 1), (99, 2), (101, 4), (1_000, 8), (u64::MAX, 16)].into_iter());
        assert_eq!(share.cycles.iter().sum::<u64>(), 31);
        assert_eq!((share.cycles[0], share.cycles[10], share.cycles.last()), (7, 8, Some(&16)));
    }

    #[test]
    fn the_longest_bar_fills_the_width_and_a_single_cycle_is_seen() {
        let share = Share::new("total", [(10_000, 1_000_000), (5_000_000, 1)].into_iter());
        let text = bars(&share, 80);
        let lengths: Vec<usize> = text.lines().map(|line| line.matches('█').count()).collect();
        assert_eq!(lengths.iter().max(), Some(&56));
        let last = text.lines().last().expect("a line for the last bin");
        assert!(last.contains(" 1  █") || last.contains(" 1  ▏"), "{last}");
        assert!(text.contains("10 us   1000000"), "{text}");
    }

    #[test]
    fn a_sheet_shows_each_share_that_has_cycles() {
        let shares =
            [Share::new("collect", [(10_000, 5)].into_iter()), Share::new("total", std::iter::empty())];
        let sheet = sheet("a run", &shares);
        assert!(sheet.contains("collect") && !sheet.contains(">total<") && sheet.contains("a run"));
    }
}
