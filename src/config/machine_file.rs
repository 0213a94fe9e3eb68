//! The mirror of the machine file: one function per section, in the order of the file, with the range
//! of each value. Truths between values are in `rules.rs`.
//! Invariant: every key of the file is asked for here, and nowhere else.

use super::machine::{AXIS_NAMES, Axis, BusSettings, Cycle, Machine, Motion, Supervision, VelocityForm};
use super::problem::FileProblems;
use super::reader::{Notes, Section, parse};
use super::sheet_file::{self, Shelf};
use super::{Purpose, rules};
use crate::base::axis::PerAxis;
use crate::base::time::Span;
use crate::base::units::{Acceleration, Current, Force, Position, Velocity};
use crate::plant::effects::{CATALOGUE, Effects, Entry, VALUES_MAX, Values};
use crate::plant::{self, Actuator, Mechanics, friction};
use crate::rt::control::{self, GAIN_SETS_MAX, Gains, compensation, limits::Limits, position, velocity_pi};
use crate::rt::cycle::{bucket::BucketLimit, mode::Patience};
use crate::rt::drive::sheet::{CommandApplies, Sheet};
use crate::rt::drive::velocity::VelocityEstimate;
use crate::rt::thread;
use crate::rt::wire::scaling::{AxisScale, ScaleSettings, Sense};
use crate::rt::wire::{Layout, Node};

/// Read a machine with the sheets of a shelf.
pub(super) fn read(
    purpose: Purpose,
    source: &str,
    text: &str,
    shelf: Shelf<'_>,
) -> Result<Machine, FileProblems> {
    let table = parse(source, text)?;
    let notes = Notes::default();
    let root = Section::root(&table, &notes);
    let name = root.text("name");
    let cycle = cycle(root.section("cycle"));
    let real_time = real_time(root.section("real-time"));
    let bus = bus(root.section("bus"));
    let supervision = supervision(root.section("supervision"));
    let motion = motion(root.section("motion"));
    let axis_section = root.section("axis");
    let gain_sets = gain_set_names(&axis_section);
    let axes = axes(&axis_section, &cycle, &gain_sets, &shelf);
    axis_section.close();
    let machine = Machine {
        name,
        source: source.to_owned(),
        text: text.to_owned(),
        sheets: shelf.taken(),
        cycle,
        real_time,
        bus,
        supervision,
        motion,
        gain_sets,
        axes,
    };
    rules::check(&root, &machine, purpose);
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
    section.close();
    cycle
}

fn real_time(section: Section<'_>) -> thread::Settings {
    let settings = thread::Settings {
        // Not 99: the kernel's own threads that nothing may delay are there.
        priority: section.whole("priority", 1..=98, "") as u8,
        // No processor means any: which ones exist is known on the machine, not in its file.
        cpu: section.optional_whole("cpu", 0..=1023, "").map(|cpu| cpu as u16),
    };
    section.close();
    settings
}

fn bus(section: Section<'_>) -> BusSettings {
    let layout = section.choice("format", &[("fd", Layout::Fd), ("classic", Layout::Classic)]);
    let nominal = section.whole("nominal-bit-rate-kbit-per-s", 10..=1_000, "kbit/s");
    let data = section.whole("data-bit-rate-kbit-per-s", 10..=8_000, "kbit/s");
    section.close();
    BusSettings { layout, nominal_bit_per_s: nominal as u32 * 1_000, data_bit_per_s: data as u32 * 1_000 }
}

fn supervision(section: Section<'_>) -> Supervision {
    let supervision = Supervision {
        stale_cycles_max: section.whole("stale-cycles-max", 0..=100, "cycles") as u32,
        heartbeat_timeout: Span::ms(section.whole("heartbeat-timeout-ms", 1..=60_000, "ms")),
        patience: Patience {
            enabling: Span::ms(section.whole("enable-timeout-ms", 10..=60_000, "ms")),
            stopping: Span::ms(section.whole("stop-timeout-ms", 10..=60_000, "ms")),
        },
        pause_cycles_max: section.whole("pause-cycles-max", 0..=1_000_000, "cycles") as u32,
        overruns: BucketLimit {
            misses_max: section.whole("overrun-misses-max", 0..=1_000_000, "") as u32,
            drain_cycles: section.whole("overrun-drain-cycles", 1..=1_000_000, "cycles") as u32,
        },
        losses: BucketLimit {
            misses_max: section.whole("bus-losses-max", 0..=1_000_000, "") as u32,
            drain_cycles: section.whole("bus-loss-drain-cycles", 1..=1_000_000, "cycles") as u32,
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

/// Gain sets are named by the first axis that has some; the others must have the same ones.
fn gain_set_names(axes: &Section<'_>) -> Vec<String> {
    AXIS_NAMES
        .iter()
        .map(|name| axes.keys_of(&format!("{name}.gains")))
        .find(|sets| !sets.is_empty())
        .unwrap_or_default()
}

fn axes(section: &Section<'_>, cycle: &Cycle, sets: &[String], shelf: &Shelf<'_>) -> PerAxis<Axis> {
    let names: Vec<String> = section.keys();
    let count = names.len().clamp(1, AXIS_NAMES.len());
    for name in &names {
        if !AXIS_NAMES[..count].contains(&name.as_str()) {
            let wanted = AXIS_NAMES[..count].join(", ");
            section.object(name, format!("{} axes are named {wanted}", names.len()), "not an axis name here");
            section.skip(name);
        }
    }
    let read = |name: &&str| {
        // A wrong name stands for a missing one, and was noted.
        let is_there = names.is_empty() || names.iter().any(|known| known == name);
        let section = if is_there { section.section(name) } else { section.absent(name) };
        axis(section, cycle, sets, shelf)
    };
    let axes: Vec<Axis> = AXIS_NAMES[..count].iter().map(read).collect();
    PerAxis::from_fn(count, |id| axes[id.index()])
}

fn axis(section: Section<'_>, cycle: &Cycle, sets: &[String], shelf: &Shelf<'_>) -> Axis {
    let board = section.section("board");
    let node = Node::new(board.whole("node", 1..=127, "") as u8).unwrap_or(Node::MAX);
    let feedback_latency = Span::us(board.whole("feedback-latency-us", 0..=20_000, "us"));
    let drive = section.section("drive");
    let actuator = actuator(&drive);
    let current_noise = Current::a(drive.number("current-noise-a-rms", 0.0..=1_000.0, "A"));
    let encoder = section.section("motor-encoder");
    let velocity_estimate = encoder.choice("velocity-estimate", &VelocityEstimate::NAMED);
    let table = section.optional_section("table-scale");
    let senses = (sense(&encoder), table.as_ref().map_or(Sense::Along, sense));
    let sheet = sheet(board, encoder, table, &actuator, shelf);
    drive.close();
    let base = plant::Parameters {
        mechanics: mechanics(section.section("mechanics")),
        friction: friction(section.section("friction")),
        actuator,
        effects: Effects::NONE,
    };
    let plant = match section.optional_section("effects") {
        Some(effects_section) => effects(effects_section, base),
        None => base,
    };
    let scale = AxisScale::new(&ScaleSettings {
        lead: Position::m(plant.mechanics.lead_m),
        motor_counts_per_rev: sheet.motor_counts_per_rev,
        motor_sense: senses.0,
        table_counts_per_mm: (sheet.table_counts_per_mm > 0).then_some(sheet.table_counts_per_mm),
        table_sense: senses.1,
    });
    let velocity_form = velocity_form(section.section("velocity-loop"));
    let control = control::Settings {
        tick: cycle.period,
        position_every: cycle.position_every,
        // What is another value of a parameter the control knows; the rest is for the simulation.
        axis: plant.without_effects(),
        resolution: scale.motor_resolution(),
        limits: limits(section.section("limits")),
        gain_sets: gain_sets(&section, velocity_form, cycle, sets),
        gain_set_count: sets.len().min(GAIN_SETS_MAX) as u8,
    };
    section.close();
    Axis {
        node,
        sheet,
        scale,
        feedback_latency,
        velocity_estimate,
        current_noise,
        plant,
        velocity_form,
        control,
    }
}

fn sense(section: &Section<'_>) -> Sense {
    section.choice("sense", &[("along", Sense::Along), ("against", Sense::Against)])
}

fn sheet(
    board: Section<'_>,
    encoder: Section<'_>,
    table: Option<Section<'_>>,
    actuator: &Actuator,
    shelf: &Shelf<'_>,
) -> Sheet {
    let name = board.text("sheet");
    let mut sheet = shelf.find(&name).unwrap_or_else(|cause| {
        board.conflict("sheet", &[], format!("no usable board sheet \"{name}\""), cause);
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
    board.close();
    encoder.close();
    sheet
}

fn actuator(section: &Section<'_>) -> Actuator {
    Actuator {
        torque_constant_nm_per_a: section.number("torque-constant-nm-per-a", 1e-3..=100.0, "N m/A"),
        current_loop_hz: section.number("current-loop-hz", 10.0..=20_000.0, "Hz"),
        filter_s: 0.0,
        dead_time: Span::us(section.whole("dead-time-us", 0..=20_000, "us")),
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
        backlash_m: section.number("backlash-um", 0.0..=1_000.0, "um") * 1e-6,
        carried_share: section.optional_number("carried-inertia-percent", 0.0..=50.0, "%").unwrap_or(0.0)
            * 1e-2,
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
    section.close();
    parameters
}

/// The axis with the effects of the catalogue that it has.
fn effects(section: Section<'_>, base: plant::Parameters) -> plant::Parameters {
    let mut axis = base;
    for entry in CATALOGUE {
        if let Some(section) = section.optional_section(entry.name) {
            axis = axis.with_effect(entry, effect(section, entry));
        }
    }
    section.close();
    axis
}

fn effect(section: Section<'_>, entry: &Entry) -> Values {
    let mut values = [0.0; VALUES_MAX];
    for (value, parameter) in values.iter_mut().zip(entry.parameters) {
        let [least, most] = parameter.bounds;
        *value = section.number(parameter.key, least..=most, parameter.unit);
        section.optional_interval(&format!("{}-ci95", parameter.key), *value, parameter.unit);
    }
    // Where the values come from is for those who read the file.
    for key in ["source", "date", "commit"] {
        section.optional_text(key);
    }
    section.close();
    values
}

fn limits(section: Section<'_>) -> Limits {
    let limits = Limits {
        travel_min: Position::mm(section.number("travel-min-mm", -1e5..=0.0, "mm")),
        travel_max: Position::mm(section.number("travel-max-mm", 0.0..=1e5, "mm")),
        travel_margin: Position::mm(section.number("travel-margin-mm", 0.0..=100.0, "mm")),
        velocity: Velocity::mm_per_s(section.number("velocity-mm-per-s", 0.01..=5_000.0, "mm/s")),
        acceleration: Acceleration::m_per_s2(section.number("acceleration-m-per-s2", 0.01..=100.0, "m/s^2")),
        current: Current::a(section.number("current-a", 0.01..=2_000.0, "A")),
        following_error: Position::mm(section.number("following-error-mm", 0.001..=100.0, "mm")),
        standstill: Velocity::mm_per_s(section.number("standstill-mm-per-s", 0.001..=10.0, "mm/s")),
    };
    section.close();
    limits
}

/// Eq. (5): how the paper's `V_p` and `V_i` become gains.
fn velocity_form(section: Section<'_>) -> VelocityForm {
    let is_lag = section.choice("form", &[("integrator", false), ("lag", true)]);
    let a_nm_s_per_rad = section.number("a-nm-s-per-rad", 1e-9..=1e3, "N m s/rad");
    let form = if is_lag {
        VelocityForm::Lag {
            a_nm_s_per_rad,
            b: section.number("b", 0.0..=1e9, ""),
            t_s: section.number("t-s", 1e-6..=1e6, "s"),
        }
    } else {
        let b_per_t_per_s = section.number("b-per-t-per-s", 0.0..=1e9, "1/s");
        VelocityForm::Integrator { a_nm_s_per_rad, b_per_t_per_s }
    };
    section.close();
    form
}

fn gain_sets(
    axis: &Section<'_>,
    form: VelocityForm,
    cycle: &Cycle,
    names: &[String],
) -> [Gains; GAIN_SETS_MAX] {
    let section = axis.section("gains");
    // A sampled position loop is stable only below 2 / T_p; half of that still rings.
    let kp_max = 1.0 / (cycle.period.as_s() * f64::from(cycle.position_every));
    let read = |set: &Section<'_>| Gains {
        position: position::Gains {
            gain_per_s: set.number("kp-per-s", 0.1..=kp_max.min(1_000.0), "1/s"),
            velocity_feed_forward: set.number("velocity-feed-forward", 0.0..=1.0, ""),
        },
        velocity: form.gains(set.number("v-p", 1e-6..=1e6, ""), set.number("v-i", 0.0..=1e6, "")),
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
    match sets.len() {
        0 => axis.conflict("gains", &[], "holds no gain set", "wanted is one section or more, as `standard`"),
        1..=GAIN_SETS_MAX => {}
        many => {
            axis.conflict(
                "gains",
                &[],
                format!("{many} gain sets"),
                format!("allowed are 1 to {GAIN_SETS_MAX}"),
            );
        }
    }
    std::array::from_fn(|index| sets.get(index).or(sets.last()).copied().unwrap_or(NO_GAINS))
}

/// What stands in for a gain set that is not there.
const NO_GAINS: Gains = Gains {
    position: position::Gains { gain_per_s: 0.0, velocity_feed_forward: 0.0 },
    velocity: velocity_pi::Gains {
        proportional_nm_s_per_rad: 0.0,
        memory: velocity_pi::Memory::Integrator { gain_nm_per_rad: 0.0 },
    },
    compensation: compensation::Gains { friction: 0.0, inertia: 0.0 },
};
