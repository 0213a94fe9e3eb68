//! The mirror of the machine file: one function per section, in the order of the file.

use std::path::Path;

use super::bus_load::BusLoad;
use super::machine::{AXIS_NAMES, Axis, BusRates, Cycle, Machine, Motion, Supervision};
use super::problem::FileProblems;
use super::reader::{Notes, Section, parse};
use super::sheet_file;
use crate::base::axis::PerAxis;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Force, Position, Velocity};
use crate::plant::{self, Actuator, Mechanics, friction};
use crate::rt::control::{self, GAIN_SETS_MAX, Gains, compensation, limits::Limits, position, velocity_pi};
use crate::rt::cycle::bucket::BucketLimit;
use crate::rt::cycle::mode::Patience;
use crate::rt::drive::sheet::{CommandApplies, Sheet};
use crate::rt::drive::velocity::VelocityEstimate;
use crate::rt::wire::Node;
use crate::rt::wire::scaling::{AxisScale, ScaleSettings, Sense};

/// Share of the bus that the cycle's frames may take with all the stuff bits they can need; the rest is
/// for heartbeats, emergencies and retransmission.
const BUS_LOAD_MAX: f64 = 0.9;

/// Read a machine; sheets are looked for in `folder` before the embedded ones.
pub(super) fn read(source: &str, text: &str, folder: Option<&Path>) -> Result<Machine, FileProblems> {
    let notes = Notes::default();
    let table = parse(text, &notes);
    let root = Section::root(&table, &notes);
    let name = root.text("name");
    let cycle = cycle(root.section("cycle"));
    let bus = bus(root.section("bus"));
    let supervision = supervision(root.section("supervision"));
    let motion = motion(root.section("motion"));
    let axis_section = root.section("axis");
    let gain_sets = gain_set_names(&axis_section);
    let axes = axes(&axis_section, &cycle, &gain_sets, folder);
    axis_section.close();
    let machine = Machine {
        name,
        source: source.to_owned(),
        text: text.to_owned(),
        cycle,
        bus,
        supervision,
        motion,
        gain_sets,
        axes,
    };
    check_bus(&root, &machine);
    root.close();
    notes.into_result(source, text, machine)
}

fn cycle(section: Section<'_>) -> Cycle {
    let period_us = section.whole("period-us", 50..=20_000, "us");
    let cycle = Cycle {
        period: Span::us(period_us),
        position_every: section.whole("position-loop-every-cycles", 1..=100, "cycles") as u32,
        reply_window: Span::us(section.whole("reply-window-us", 10..=20_000, "us")),
    };
    if cycle.reply_window >= cycle.period {
        let title = format!("{} us leaves no time in a period of {period_us} us", cycle.reply_window.as_us());
        section.object("reply-window-us", title, format!("allowed is less than {period_us} us"));
    }
    section.close();
    cycle
}

fn bus(section: Section<'_>) -> BusRates {
    section.choice("format", &[("fd", ())]);
    let nominal = section.whole("nominal-bit-rate-kbit-per-s", 10..=1_000, "kbit/s");
    let data = section.whole("data-bit-rate-kbit-per-s", 10..=8_000, "kbit/s");
    if data < nominal {
        let title = format!("{data} kbit/s is below the nominal bit rate");
        section.object("data-bit-rate-kbit-per-s", title, format!("allowed is {nominal} kbit/s or more"));
    }
    section.close();
    BusRates { nominal_bit_per_s: nominal as u32 * 1_000, data_bit_per_s: data as u32 * 1_000 }
}

fn supervision(section: Section<'_>) -> Supervision {
    let supervision = Supervision {
        stale_cycles_max: section.whole("stale-cycles-max", 0..=100, "cycles") as u32,
        heartbeat_timeout: Span::ms(section.whole("heartbeat-timeout-ms", 1..=60_000, "ms")),
        patience: Patience {
            enabling: Span::ms(section.whole("enable-timeout-ms", 10..=60_000, "ms")),
            stopping: Span::ms(section.whole("stop-timeout-ms", 10..=60_000, "ms")),
        },
        overruns: BucketLimit {
            misses_max: section.whole("overrun-misses-max", 0..=1_000_000, "") as u32,
            drain_cycles: section.whole("overrun-drain-cycles", 1..=1_000_000, "cycles") as u32,
        },
    };
    section.close();
    supervision
}

fn motion(section: Section<'_>) -> Motion {
    let motion = Motion {
        positioning_feed: Velocity::mm_per_min(section.number(
            "positioning-feed-mm-per-min",
            1.0..=100_000.0,
            "mm/min",
        )),
        path_acceleration: Acceleration::m_per_s2(section.number(
            "path-acceleration-m-per-s2",
            0.001..=50.0,
            "m/s^2",
        )),
    };
    section.close();
    motion
}

/// Gain sets are named by the first axis; the others must have the same ones.
fn gain_set_names(axes: &Section<'_>) -> Vec<String> {
    let first = axes.keys().into_iter().next().unwrap_or_default();
    let Some(axis) = axes.optional_section(&first) else { return vec![String::new()] };
    let names = axis.optional_section("gains").map(|gains| gains.keys()).unwrap_or_default();
    if names.len() > GAIN_SETS_MAX {
        let title = format!("{} gain sets", names.len());
        axis.object("gains", title, format!("allowed are {GAIN_SETS_MAX}"));
    }
    if names.is_empty() { vec![String::new()] } else { names.into_iter().take(GAIN_SETS_MAX).collect() }
}

fn axes(section: &Section<'_>, cycle: &Cycle, sets: &[String], folder: Option<&Path>) -> PerAxis<Axis> {
    let names: Vec<String> = section.keys();
    let count = names.len().clamp(1, AXIS_NAMES.len());
    for name in &names {
        if !AXIS_NAMES[..count].contains(&name.as_str()) {
            let wanted = AXIS_NAMES[..count].join(", ");
            section.object(name, format!("{} axes are named {wanted}", names.len()), "not an axis name here");
            section.optional_section(name);
        }
    }
    let axes =
        PerAxis::from_fn(count, |id| axis(section.section(AXIS_NAMES[id.index()]), cycle, sets, folder));
    for (id, axis) in axes.iter() {
        if axes.iter().any(|(other, twin)| other < id && twin.node == axis.node) {
            let board = section.section(AXIS_NAMES[id.index()]).section("board");
            board.object(
                "node",
                format!("{} is another axis' node", axis.node.number()),
                "each axis has its own",
            );
        }
    }
    axes
}

fn axis(section: Section<'_>, cycle: &Cycle, sets: &[String], folder: Option<&Path>) -> Axis {
    let board = section.section("board");
    let node = Node::new(board.whole("node", 1..=127, "") as u8).unwrap_or(Node::MAX);
    let feedback_latency = Span::us(board.whole("feedback-latency-us", 0..=20_000, "us"));
    if feedback_latency > cycle.period {
        let title = format!("{} us is longer than a period", feedback_latency.as_us());
        board.object("feedback-latency-us", title, format!("allowed is 0 to {} us", cycle.period.as_us()));
    }
    let drive = section.section("drive");
    let actuator = actuator(&drive, cycle);
    let current_noise = Current::a(drive.number("current-noise-a-rms", 0.0..=1_000.0, "A"));
    let encoder = section.section("motor-encoder");
    let velocity_estimate = encoder.choice(
        "velocity-estimate",
        &[("difference", VelocityEstimate::Difference), ("second-order", VelocityEstimate::SecondOrder)],
    );
    let table = section.optional_section("table-scale");
    let senses = (sense(&encoder), table.as_ref().map_or(Sense::Along, sense));
    let sheet = sheet(board, encoder, table, (&drive, &actuator), folder);
    drive.close();
    let plant = plant::Parameters {
        mechanics: mechanics(section.section("mechanics")),
        friction: friction(section.section("friction")),
        actuator,
    };
    let control = control::Settings {
        tick: cycle.period,
        position_every: cycle.position_every,
        axis: plant,
        limits: limits(section.section("limits"), &sheet),
        gain_sets: gain_sets(&section, cycle, sets),
        gain_set_count: sets.len() as u8,
    };
    section.close();
    let scale = AxisScale::new(&ScaleSettings {
        lead: Position::m(plant.mechanics.lead_m),
        motor_counts_per_rev: sheet.motor_counts_per_rev,
        motor_sense: senses.0,
        table_counts_per_mm: (sheet.table_counts_per_mm > 0).then_some(sheet.table_counts_per_mm),
        table_sense: senses.1,
    });
    Axis { node, sheet, scale, feedback_latency, velocity_estimate, current_noise, plant, control }
}

fn sense(section: &Section<'_>) -> Sense {
    section.choice("sense", &[("along", Sense::Along), ("against", Sense::Against)])
}

fn sheet(
    board: Section<'_>,
    encoder: Section<'_>,
    table: Option<Section<'_>>,
    (drive, actuator): (&Section<'_>, &Actuator),
    folder: Option<&Path>,
) -> Sheet {
    let name = board.text("sheet");
    let mut sheet = sheet_file::find(&name, folder).unwrap_or_else(|cause| {
        board.object("sheet", format!("no usable board sheet \"{name}\""), cause);
        sheet_file::placeholder()
    });
    sheet.command_applies = board.choice(
        "command-applies",
        &[("on-receipt", CommandApplies::OnReceipt), ("on-next-sync", CommandApplies::OnNextSync)],
    );
    sheet.motor_counts_per_rev = encoder.whole("counts-per-rev", 100..=1 << 30, "counts") as u32;
    sheet.table_counts_per_mm = table.map_or(0, |table| {
        let counts = table.whole("counts-per-mm", 1..=1 << 30, "counts");
        table.close();
        counts as u32
    });
    sheet.peak_current_ma = (actuator.peak_current.as_a() * 1e3).round() as u32;
    if sheet.peak_current_ma < sheet.rated_current_ma {
        let rated_a = f64::from(sheet.rated_current_ma) * 1e-3;
        let title = format!("peak current below the rated current of the board, {rated_a} A");
        drive.object("peak-current-a", title, format!("allowed is {rated_a} A or more"));
    }
    board.close();
    encoder.close();
    sheet
}

fn actuator(section: &Section<'_>, cycle: &Cycle) -> Actuator {
    let dead_time = Span::us(section.whole("dead-time-us", 0..=20_000, "us"));
    let ticks_max = plant::DEAD_TICKS_MAX as i64 - 1;
    if dead_time > cycle.period * ticks_max {
        let bound_us = (cycle.period * ticks_max).as_us();
        let title = format!("{} us is more than {ticks_max} periods", dead_time.as_us());
        section.object("dead-time-us", title, format!("allowed is 0 to {bound_us} us"));
    }
    Actuator {
        torque_constant_nm_per_a: section.number("torque-constant-nm-per-a", 1e-3..=100.0, "N m/A"),
        current_loop_hz: section.number("current-loop-hz", 10.0..=20_000.0, "Hz"),
        dead_time: dead_time.min(cycle.period * ticks_max),
        peak_current: Current::a(section.number("peak-current-a", 0.1..=2_000.0, "A")),
    }
}

fn mechanics(section: Section<'_>) -> Mechanics {
    let mechanics = Mechanics {
        mass_kg: section.number("mass-kg", 0.1..=100_000.0, "kg"),
        stiffness_n_per_m: section.number("stiffness-n-per-um", 0.1..=10_000.0, "N/um") * 1e6,
        damping_n_s_per_m: section.number("damping-n-s-per-mm", 0.0..=10_000.0, "N s/mm") * 1e3,
        inertia_kg_m2: section.number("motor-inertia-kg-m2", 1e-6..=10.0, "kg m^2"),
        lead_m: section.number("lead-mm", 0.1..=200.0, "mm") * 1e-3,
        efficiency: section.number("efficiency", 0.1..=1.0, ""),
    };
    section.close();
    mechanics
}

fn friction(section: Section<'_>) -> friction::Parameters {
    let variants = [("nonlinear", friction::Variant::Nonlinear), ("linear", friction::Variant::Linear)];
    let parameters = friction::Parameters {
        variant: section.choice("variant", &variants),
        breakaway: Force::n(section.number("breakaway-n", 0.0..=1e6, "N")),
        sliding: Force::n(section.number("sliding-n", 0.0..=1e6, "N")),
        fall_end: Velocity::mm_per_s(section.number("fall-end-mm-per-s", 1e-4..=100.0, "mm/s")),
        fall_start: Velocity::mm_per_s(section.number("fall-start-mm-per-s", 0.0..=100.0, "mm/s")),
        viscous_n_s_per_m: section.number("viscous-n-s-per-mm", 0.0..=1_000.0, "N s/mm") * 1e3,
    };
    if parameters.sliding > parameters.breakaway {
        let title = format!("{} is above the break-away force", parameters.sliding);
        section.object("sliding-n", title, format!("allowed is 0 to {}", parameters.breakaway));
    }
    if parameters.fall_start >= parameters.fall_end {
        let end = parameters.fall_end.as_mm_per_s();
        let title = format!("{:.4} mm/s is not below the fall's end", parameters.fall_start.as_mm_per_s());
        section.object("fall-start-mm-per-s", title, format!("allowed is less than {end:.4} mm/s"));
    }
    section.close();
    parameters
}

fn limits(section: Section<'_>, sheet: &Sheet) -> Limits {
    let limits = Limits {
        travel_min: Position::mm(section.number("travel-min-mm", -1e5..=1e5, "mm")),
        travel_max: Position::mm(section.number("travel-max-mm", -1e5..=1e5, "mm")),
        travel_margin: Position::mm(section.number("travel-margin-mm", 0.0..=100.0, "mm")),
        velocity: Velocity::mm_per_s(section.number("velocity-mm-per-s", 0.01..=5_000.0, "mm/s")),
        acceleration: Acceleration::m_per_s2(section.number("acceleration-m-per-s2", 0.01..=100.0, "m/s^2")),
        current: Current::a(section.number("current-a", 0.01..=2_000.0, "A")),
        following_error: Position::mm(section.number("following-error-mm", 0.001..=100.0, "mm")),
        standstill: Velocity::mm_per_s(section.number("standstill-mm-per-s", 0.001..=10.0, "mm/s")),
    };
    if limits.travel_min >= limits.travel_max {
        let bound = limits.travel_max.as_mm();
        let title = format!("{} mm is not below the upper end", limits.travel_min.as_mm());
        section.object("travel-min-mm", title, format!("allowed is less than {bound} mm"));
    }
    let peak_a = f64::from(sheet.peak_current_ma) * 1e-3;
    if limits.current.as_a() > peak_a {
        let title = format!("{} A is above the drive's peak current", limits.current.as_a());
        section.object("current-a", title, format!("allowed is 0.01 to {peak_a} A"));
    }
    section.close();
    limits
}

/// Eq. (5): how the paper's `V_p` and `V_i` become gains.
enum Form {
    Integrator { a: f64, b_per_t: f64 },
    Lag { a: f64, b: f64, t_s: f64 },
}

impl Form {
    fn read(section: Section<'_>) -> Self {
        let is_lag = section.choice("form", &[("integrator", false), ("lag", true)]);
        let a = section.number("a-nm-s-per-rad", 1e-9..=1e3, "N m s/rad");
        let form = if is_lag {
            Self::Lag {
                a,
                b: section.number("b", 0.0..=1e9, ""),
                t_s: section.number("t-s", 1e-6..=1e6, "s"),
            }
        } else {
            Self::Integrator { a, b_per_t: section.number("b-per-t-per-s", 0.0..=1e9, "1/s") }
        };
        section.close();
        form
    }

    fn gains(&self, v_p: f64, v_i: f64) -> velocity_pi::Gains {
        match *self {
            Self::Integrator { a, b_per_t } => velocity_pi::Gains {
                proportional_nm_s_per_rad: a * v_p,
                memory: velocity_pi::Memory::Integrator { gain_nm_per_rad: a * v_p * v_i * b_per_t },
            },
            Self::Lag { a, b, t_s } => velocity_pi::Gains {
                proportional_nm_s_per_rad: a * v_p,
                memory: velocity_pi::Memory::Lag {
                    gain_nm_s_per_rad: a * v_p * b * v_i,
                    time_constant_s: t_s,
                },
            },
        }
    }
}

fn gain_sets(axis: &Section<'_>, cycle: &Cycle, names: &[String]) -> [Gains; GAIN_SETS_MAX] {
    let form = Form::read(axis.section("velocity-loop"));
    let section = axis.section("gains");
    // A sampled position loop is stable only below 2 / T_p; half of that still rings.
    let kp_max = 1.0 / (cycle.period.as_s() * f64::from(cycle.position_every));
    let read = |set: &Section<'_>| Gains {
        position: position::Gains {
            gain_per_s: set.number("kp-per-s", 0.1..=kp_max.min(1_000.0), "1/s"),
            velocity_feed_forward: set.number("velocity-feed-forward", 0.0..=1.0, ""),
        },
        velocity: form.gains(set.number("v-p", 0.0..=1e6, ""), set.number("v-i", 0.0..=1e6, "")),
        compensation: compensation::Gains {
            friction: set.number("friction-feed-forward", 0.0..=1.5, ""),
            inertia: set.number("inertia-feed-forward", 0.0..=1.5, ""),
        },
    };
    let sets: Vec<Gains> = names
        .iter()
        .map(|name| {
            let set = section.section(name);
            let gains = read(&set);
            set.close();
            gains
        })
        .collect();
    section.close();
    std::array::from_fn(|index| sets[index.min(sets.len() - 1)])
}

/// A cycle is: SYNC, feedback within the reply window, commands before the next SYNC.
fn check_bus(root: &Section<'_>, machine: &Machine) {
    let load = BusLoad::of(machine);
    let section = root.section("cycle");
    let [period_us, window_us] = [machine.cycle.period, machine.cycle.reply_window].map(Span::as_us);
    let [replies_us, commands_us] = [load.replies_s, load.commands_s].map(|s| s * 1e6);
    if load.share > BUS_LOAD_MAX {
        let (busy_us, percent) = (replies_us + commands_us, load.share * 100.0);
        let title = format!("frames take {busy_us:.0} us of {period_us} us: {percent:.0} % of the bus");
        section.object("period-us", title, format!("allowed is up to {} %", BUS_LOAD_MAX * 100.0));
    } else if replies_us > window_us {
        let title = format!("SYNC and feedback alone take {replies_us:.0} us");
        section.object("reply-window-us", title, format!("allowed is {replies_us:.0} us or more"));
    } else if window_us + commands_us > period_us {
        let title = format!("{window_us} us and {commands_us:.0} us of commands pass the period");
        let bound_us = (period_us - commands_us).floor();
        section.object("reply-window-us", title, format!("allowed is up to {bound_us} us"));
    }
}
