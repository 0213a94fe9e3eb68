//! The page, in the order an engineer reads it: what was tested, is it good, the picture, why.
//!
//! Invariant: text from outside (names, notes) is escaped by the template; numbers carry their unit.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::TestSheet;
use crate::offline::circle::protrusion::{Protrusion, mean_height_um};
use crate::offline::circle::{CircularTest, PathAnalysis, PointAnalysis, Quadrant, Run};
use crate::offline::draw::scale::signed;
use crate::offline::draw::{overview, polar, reversals};

const STYLE: &str = "
:root{color-scheme:light}
body{font:15px/1.45 'DejaVu Sans',Verdana,sans-serif;color:#1a1a1a;background:#fff;margin:1.5rem auto;max-width:1100px;padding:0 1rem}
h1{font-size:1.5rem;margin:0 0 .2rem}h2{font-size:1.1rem;margin:1.8rem 0 .5rem;border-bottom:1px solid #ccc}
p.sub{color:#555;margin:0 0 1rem}
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.3rem 0 .8rem}
th,td{padding:.22rem .7rem;border-bottom:1px solid #e2e2e2;text-align:right;vertical-align:top}
th:first-child,td:first-child{text-align:left;padding-left:0}
thead th{border-bottom:1.5px solid #777}caption{text-align:left;font-weight:bold;padding:.2rem 0}
table.facts td{text-align:left}table.facts td:first-child{color:#555}
.yes{color:#11622b;font-weight:bold}.no{color:#a3121f;font-weight:bold}
svg{width:100%;height:auto}figure{margin:0;break-inside:avoid}
table{break-inside:avoid}
@media print{@page{size:A4;margin:12mm}body{font-size:9.5pt;margin:0;max-width:none;padding:0}h2{break-after:avoid}}
";

/// What the test was, in one line.
pub(super) fn title(sheet: &TestSheet, test: &CircularTest) -> String {
    format!(
        "Circular test · {} · {} gains · R {} mm · {:.0} mm/min",
        sheet.machine, sheet.gains, test.radius_mm, test.feed_mm_per_min
    )
}

/// The whole page.
pub(super) fn render(sheet: &TestSheet, test: &CircularTest, runs: &[Run<'_>]) -> String {
    let title = title(sheet, test);
    let body = html! {
        h1 { "Circular test: " (sheet.machine) ", " (sheet.gains) " gains" }
        p.sub { "ISO 230-4 · radius " (test.radius_mm) " mm · feed " (format!("{:.0}", test.feed_mm_per_min)) " mm/min · " (sheet.date) }
        (facts(sheet, test))
        h2 { "Result" }
        (result(test))
        @if !sheet.expectations.is_empty() { (expectations(sheet)) }
        h2 { "Path, deviation magnified" }
        figure { (PreEscaped(polar::draw(test, &title))) }
        h2 { "The four reversals" }
        figure { (PreEscaped(reversals::draw(test, runs))) }
        (protrusions(test))
        h2 { "Velocity and current" }
        figure { (PreEscaped(overview::draw(runs))) }
        h2 { "Quantities of ISO 230-4 and of each axis" }
        @for point in test.points() { (quantities(point)) }
        h2 { "Notes" }
        (notes(sheet, test))
    };
    whole(&title, &body)
}

/// A page with this body: the head and the look that all reports share.
pub(super) fn whole(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { (body) }
        }
    };
    page.into_string()
}

fn facts(sheet: &TestSheet, test: &CircularTest) -> Markup {
    let senses: Vec<&str> = test.motor.directions.iter().map(|analysis| analysis.direction.name()).collect();
    let turns = if test.revolutions == 1 { "revolution" } else { "revolutions" };
    html! {
        table.facts {
            tr { td { "Machine" } td { (sheet.machine) } }
            tr { td { "Gains" } td { (sheet.gains) } }
            tr { td { "Path" } td { "radius " (test.radius_mm) " mm, " (format!("{:.0}", test.feed_mm_per_min)) " mm/min, " (senses.join(" and ")) ", " (test.revolutions) " " (turns) " each" } }
            tr { td { "Run" } td { (sheet.pace) ", " (sheet.cycles) " cycles, " (sheet.overruns) " overruns, " (sheet.lost_records) " lost records" } }
            tr { td { "Log" } td { @if sheet.log.is_empty() { "none" } @else { (sheet.log) } } }
            tr { td { "Program" } td { "commit " (sheet.commit) } }
        }
    }
}

fn um(value: f64) -> String {
    signed(value, 1)
}

/// The summary: one column for each measuring point.
fn result(test: &CircularTest) -> Markup {
    let row = |name: &str, value: &dyn Fn(&PointAnalysis) -> Option<f64>| {
        html! { tr { td { (name) } @for point in test.points() { td { (value(point).map_or("–".to_owned(), um)) } } } }
    };
    html! {
        table {
            thead { tr { th { "all in µm" } @for point in test.points() { th { (point.point.name()) } } } }
            tbody {
                (row("Protrusion, highest", &|point| Some(point.protrusion_um.max)))
                @for quadrant in Quadrant::ALL {
                    (row(&format!("– at {} ({:.0}°)", quadrant.label(), quadrant.angle_deg()), &|point| Some(point.protrusion_um.of_quadrant(quadrant))))
                }
                (row("Radius decrease", &|point| Some(point.radius_decrease_um)))
                (row("Circular deviation G", &|point| Some(point.circular_deviation_um)))
                (row("Bidirectional circular deviation G(b)", &|point| point.bidirectional_circular_deviation_um))
            }
        }
    }
}

fn expectations(sheet: &TestSheet) -> Markup {
    html! {
        table {
            thead { tr { th { "Compared with" } th { "measured" } th { "expected" } th { "verdict" } } }
            tbody {
                @for expectation in &sheet.expectations {
                    tr {
                        td { (expectation.quantity) " (" (expectation.source) ")" }
                        td { (signed(expectation.measured_um, 2)) " µm" }
                        td { (signed(expectation.expected_um, 2)) " ± " (signed(expectation.tolerance_um, 2)) " µm" }
                        td { @if expectation.is_met() { span.yes { "within" } } @else { span.no { "outside" } } }
                    }
                }
            }
        }
    }
}

fn protrusions(test: &CircularTest) -> Markup {
    html! {
        @for point in test.points() {
            table {
                caption { "Protrusions at the " (point.point.name()) }
                thead { tr {
                    th { "where" } th { "turn" } th { "height / µm" } th { "over arc / µm" } th { "undershoot / µm" }
                    th { "angle / °" } th { "width / ms" } th { "width / °" } th { "delay / ms" }
                } }
                tbody {
                    @for analysis in &point.directions {
                        @for protrusion in &analysis.protrusions { (protrusion_row(analysis, protrusion)) }
                        @if test.revolutions > 1 { (mean_row(analysis)) }
                    }
                }
            }
        }
    }
}

fn protrusion_row(analysis: &PathAnalysis, protrusion: &Protrusion) -> Markup {
    let optional =
        |value: Option<f64>, decimals| value.map_or("–".to_owned(), |value| signed(value, decimals));
    html! {
        tr {
            td { (analysis.direction) " " (protrusion.quadrant.label()) }
            td { (protrusion.revolution) }
            td { (signed(protrusion.height_um, 2)) }
            td { (signed(protrusion.height_over_arc_um, 2)) }
            td { (signed(protrusion.undershoot_um, 2)) }
            td { (signed(protrusion.angle_deg, 2)) }
            td { (optional(protrusion.width_ms, 0)) }
            td { (optional(protrusion.width_deg, 2)) }
            td { (signed(protrusion.delay_ms, 0)) }
        }
    }
}

fn mean_row(analysis: &PathAnalysis) -> Markup {
    let mean =
        |quadrant| mean_height_um(&analysis.protrusions, quadrant).map_or("–".to_owned(), |h| signed(h, 2));
    let means: Vec<String> = Quadrant::ALL
        .into_iter()
        .map(|quadrant| format!("{} {}", quadrant.label(), mean(quadrant)))
        .collect();
    html! { tr { td colspan="9" { (analysis.direction) " mean height over the turns: " (means.join(", ")) " µm" } } }
}

fn quantities(point: &PointAnalysis) -> Markup {
    let row = |name: &str, value: &dyn Fn(&PathAnalysis) -> String| {
        html! { tr { td { (name) } @for analysis in &point.directions { td { (value(analysis)) } } } }
    };
    html! {
        table {
            caption { "At the " (point.point.name()) }
            thead { tr { th {} @for analysis in &point.directions { th { (analysis.direction) } } } }
            tbody {
                (row("Circular deviation G, minimum zone / µm", &|a| signed(a.values.circular_deviation_um, 2)))
                (row("Circular deviation, least-squares centre / µm", &|a| signed(a.values.circular_deviation_least_squares_um, 2)))
                (row("Radial deviation F max / µm", &|a| signed(a.values.radial_deviation_um_max, 2)))
                (row("Radial deviation F min / µm", &|a| signed(a.values.radial_deviation_um_min, 2)))
                (row("Radius decrease, arcs between reversals / µm", &|a| signed(a.values.radius_decrease_um, 2)))
                (row("Mean radius, least squares / mm", &|a| format!("{:.5}", a.values.mean_radius_mm)))
                (row("Centre offset X / µm", &|a| signed(a.values.centre_offset_x_um, 2)))
                (row("Centre offset Y / µm", &|a| signed(a.values.centre_offset_y_um, 2)))
                (row("Lag of X / ms", &|a| signed(a.values.x.lag_ms, 2)))
                (row("Lag of X minus lag of Y / ms", &|a| signed(a.values.lag_difference_ms, 3)))
                (row("Lost motion X / µm", &|a| signed(a.values.x.lost_motion_um, 2)))
                (row("Lost motion Y / µm", &|a| signed(a.values.y.lost_motion_um, 2)))
                (row("Samples", &|a| a.values.samples.to_string()))
            }
        }
    }
}

fn notes(sheet: &TestSheet, test: &CircularTest) -> Markup {
    let is_shortened = test.motor.directions.iter().any(|analysis| analysis.is_guard_shortened);
    let baseline = test.motor.directions.first().and_then(|analysis| analysis.protrusions.first());
    html! {
        ul {
            @if let Some(protrusion) = baseline {
                li { "Heights are measured above the " (protrusion.baseline.name()) ". At the table they contain the wind-up of the screw." }
            }
            li { "Radius decrease is the nominal radius minus that of the arcs between the reversals; protrusions and wind-up do not enter it." }
            @if is_shortened { li { "The quadrants pass so fast that the tails of the reversals reach into the arcs: heights over the arc and the radius decrease are a little too small." } }
            @if test.missing_cycles > 0 { li.no { (test.missing_cycles) " cycles are missing." } }
            @if test.stale_samples > 0 { li.no { (test.stale_samples) " samples were not fresh in their cycle and are left out." } }
            @if sheet.lost_records > 0 { li.no { (sheet.lost_records) " records were lost on the way to the log." } }
            @if sheet.overruns > 0 { li.no { (sheet.overruns) " periods were skipped because a cycle came late." } }
            @for note in &sheet.notes { li { (note) } }
        }
    }
}
