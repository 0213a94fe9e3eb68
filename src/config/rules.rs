//! Truths between the values of a machine file, judged once each value is right by itself.
//!
//! A rule speaks at the key that is most likely wrong and says what the others allow; it is silent when
//! one of its values has a problem of its own. Rules about single values are ranges in
//! `machine_file.rs`; what is allowed but worth a look is a warning of `quadrant check`.
//! Invariant: a machine that passed keeps every promise that constructors below `config` rely on.

use super::Purpose;
use super::bus_load::BusLoad;
use super::machine::{AXIS_NAMES, Axis, Machine};
use super::reader::Section;
use crate::base::time::Span;
use crate::plant::FILE_DEAD_TICKS_MAX;
use crate::rt::control::limits::JUMP_FACTOR;

/// Share of the bus that the cycle's frames may take with all the stuff bits they can need; the rest is
/// for heartbeats, emergencies and retransmission.
const BUS_LOAD_MAX: f64 = 0.9;
/// Heartbeats that fit in the time-out: one may be lost.
const HEARTBEATS_MIN: f64 = 2.0;
/// Encoder counts wrap at 2^32 and are told apart up to half of that.
const COUNTS_BETWEEN_SAMPLES_MAX: f64 = 2_147_483_648.0;

/// Judge a machine as it was read.
pub(super) fn check(root: &Section<'_>, machine: &Machine, purpose: Purpose) {
    if machine.name.trim().is_empty() {
        root.conflict("name", &[], "is empty", "wanted is what people call the machine");
    }
    cycle(root, machine);
    rates(root, machine);
    if purpose == Purpose::Bus {
        frames(root, machine);
    }
    for (id, axis) in machine.axes.iter() {
        let name = AXIS_NAMES[id.index()];
        let key = |key: &str| format!("axis.{name}.{key}");
        let section = AxisRules { root, machine, axis, key: &key };
        section.board();
        section.pause();
        section.mechanics();
        section.limits();
        section.shared();
        let twin = machine.axes.iter().find(|(other, twin)| *other < id && twin.node == axis.node);
        if let Some((other, _)) = twin {
            let other = AXIS_NAMES[other.index()];
            let title = format!("{} is already the node of axis {other}", axis.node.number());
            let theirs = format!("axis.{other}.board.node");
            root.conflict(&key("board.node"), &[&theirs], title, "each board has its own, from 1 to 127");
        }
    }
}

fn cycle(root: &Section<'_>, machine: &Machine) {
    let [period_us, window_us] = [machine.cycle.period, machine.cycle.reply_window].map(Span::as_us);
    if window_us >= period_us {
        let title = format!("{window_us} us leaves no time in a period of {period_us} us");
        let label = format!("allowed is less than {period_us} us");
        root.conflict("cycle.reply-window-us", &["cycle.period-us"], title, label);
    }
}

fn rates(root: &Section<'_>, machine: &Machine) {
    let rates = &machine.bus;
    if rates.data_bit_per_s < rates.nominal_bit_per_s {
        let [data, nominal] = [rates.data_bit_per_s, rates.nominal_bit_per_s].map(|rate| rate / 1_000);
        let title = format!("{data} kbit/s is below the nominal bit rate");
        let label = format!("allowed is {nominal} kbit/s or more");
        let others = ["bus.nominal-bit-rate-kbit-per-s"];
        root.conflict("bus.data-bit-rate-kbit-per-s", &others, title, label);
    }
}

/// A cycle is: SYNC, feedback within the reply window, commands before the next SYNC.
fn frames(root: &Section<'_>, machine: &Machine) {
    let load = BusLoad::of(machine);
    let [period_us, window_us] = [machine.cycle.period, machine.cycle.reply_window].map(Span::as_us);
    let [replies_us, commands_us] = [load.replies_s, load.commands_s].map(|s| s * 1e6);
    if load.share > BUS_LOAD_MAX {
        let (busy_us, percent) = (replies_us + commands_us, load.share * 100.0);
        let title = format!(
            "the {} frames of a cycle take {busy_us:.0} us of {period_us} us: {percent:.0} % of the bus",
            load.frames
        );
        let needed_us = (busy_us / BUS_LOAD_MAX).ceil();
        let label = format!("allowed is up to {} %: {needed_us} us or more", BUS_LOAD_MAX * 100.0);
        root.conflict("cycle.period-us", &["bus"], title, label);
    } else if replies_us > window_us {
        let title = format!("{window_us} us; SYNC and feedback alone take {replies_us:.0} us");
        let label = format!("allowed is {:.0} us or more", replies_us.ceil());
        root.conflict("cycle.reply-window-us", &["cycle.period-us", "bus"], title, label);
    } else if window_us + commands_us > period_us && window_us < period_us {
        let title = format!("{window_us} us and {commands_us:.0} us of commands pass the period");
        let label = format!("allowed is up to {} us", (period_us - commands_us).floor());
        root.conflict("cycle.reply-window-us", &["cycle.period-us", "bus"], title, label);
    }
}

/// The rules of one axis.
struct AxisRules<'r, 't> {
    root: &'r Section<'t>,
    machine: &'r Machine,
    axis: &'r Axis,
    /// Full path of a key of this axis.
    key: &'r dyn Fn(&str) -> String,
}

impl AxisRules<'_, '_> {
    /// A rule that is broken at a key of this axis, with other keys of it or of the file.
    fn broken(&self, key: &str, others: &[&str], title: String, label: String) {
        let others: Vec<String> = others
            .iter()
            .map(|other| if is_shared(other) { (*other).to_owned() } else { (self.key)(other) })
            .collect();
        let others: Vec<&str> = others.iter().map(String::as_str).collect();
        let key = if is_shared(key) { key.to_owned() } else { (self.key)(key) };
        self.root.conflict(&key, &others, title, label);
    }

    fn board(&self) {
        let (period, sheet) = (self.machine.cycle.period, &self.axis.sheet);
        let latency = self.axis.feedback_latency;
        if latency > period {
            let title = format!("{} us is longer than a period", latency.as_us());
            let label = format!("allowed is 0 to {} us", period.as_us());
            self.broken("board.feedback-latency-us", &["cycle.period-us"], title, label);
        }
        let (dead_time, longest) = (self.axis.plant.actuator.dead_time, period * FILE_DEAD_TICKS_MAX as i64);
        if dead_time > longest {
            let title = format!("{} us is more than {} periods", dead_time.as_us(), FILE_DEAD_TICKS_MAX);
            let label = format!("allowed is 0 to {} us", longest.as_us());
            self.broken("drive.dead-time-us", &["cycle.period-us"], title, label);
        }
        let [peak_a, rated_a] = [sheet.peak_current_ma, sheet.rated_current_ma].map(ampere);
        if peak_a < rated_a {
            let title = format!("{peak_a} A is below the rated current of the board");
            let label = format!("allowed is {rated_a} A or more");
            self.broken("drive.peak-current-a", &["board.sheet"], title, label);
        }
        let timeout_ms = self.machine.supervision.heartbeat_timeout.as_us() * 1e-3;
        let shortest_ms = HEARTBEATS_MIN * f64::from(sheet.heartbeat_period_ms);
        if timeout_ms < shortest_ms {
            let period_ms = sheet.heartbeat_period_ms;
            let board = (self.key)("board.sheet");
            let title = format!("{timeout_ms} ms; the board of {board} beats every {period_ms} ms");
            let label = format!("allowed is {shortest_ms} ms or more: two periods");
            self.broken("supervision.heartbeat-timeout-ms", &["board.sheet"], title, label);
        }
    }

    /// The host must see its own pause before the board does, while it still can stop under control.
    fn pause(&self) {
        let (supervision, period) = (&self.machine.supervision, self.machine.cycle.period);
        let watchdog = self.axis.sheet.watchdog();
        // The command after a pause is sent up to a period into its slot.
        let longest = watchdog.as_ns() / period.as_ns() - 2;
        if i64::from(supervision.pause_cycles_max) > longest {
            let title = format!(
                "{} cycles; the watchdog of {} trips after {} us",
                supervision.pause_cycles_max,
                (self.key)("board.sheet"),
                watchdog.as_us()
            );
            let label = match longest {
                0.. => format!("allowed is 0 to {longest} cycles of {} us", period.as_us()),
                _ => format!("no period of {} us is short enough for that watchdog", period.as_us()),
            };
            self.broken("supervision.pause-cycles-max", &["cycle.period-us", "board.sheet"], title, label);
        }
    }

    fn mechanics(&self) {
        let mechanics = &self.axis.plant.mechanics;
        let [carried, most] =
            [mechanics.carried_share, mechanics.carried_share_max()].map(|share| 1e2 * share);
        if carried > most {
            let title = format!("{} % leave too little that swings", rounded(carried));
            let label = format!("allowed is 0 to {most:.1} %");
            let others = ["mechanics.mass-kg", "mechanics.motor-inertia-kg-m2"];
            self.broken("mechanics.carried-inertia-percent", &others, title, label);
        }
        let friction = &self.axis.plant.friction;
        if friction.sliding > friction.breakaway {
            let title = format!("{} is above the break-away force", friction.sliding);
            let label = format!("allowed is 0 to {}", friction.breakaway);
            self.broken("friction.sliding-n", &["friction.breakaway-n"], title, label);
        }
        if friction.fall_start >= friction.fall_end {
            let [start, end] = [friction.fall_start, friction.fall_end].map(|v| rounded(v.as_mm_per_s()));
            let title = format!("{start} mm/s is not below the fall's end");
            let label = format!("allowed is 0 to less than {end} mm/s");
            self.broken("friction.fall-start-mm-per-s", &["friction.fall-end-mm-per-s"], title, label);
        }
    }

    fn limits(&self) {
        let limits = &self.axis.control.limits;
        if limits.travel_min >= limits.travel_max {
            let [low, high] = [limits.travel_min, limits.travel_max].map(|end| rounded(end.as_mm()));
            let title = format!("{high} mm is not above the lower end");
            let label = format!("allowed is more than {low} mm");
            self.broken("limits.travel-max-mm", &["limits.travel-min-mm"], title, label);
        }
        let (current_a, peak_a) = (limits.current.as_a(), ampere(self.axis.sheet.peak_current_ma));
        if current_a > peak_a {
            let title = format!("{current_a} A is above the drive's peak current");
            let label = format!("allowed is 0.01 to {peak_a} A");
            self.broken("limits.current-a", &["drive.peak-current-a"], title, label);
        }
        if limits.standstill >= limits.velocity {
            let [slow, fast] = [limits.standstill, limits.velocity].map(|v| rounded(v.as_mm_per_s()));
            let title = format!("{slow} mm/s is not below the velocity limit");
            let label = format!("allowed is 0.001 to less than {fast} mm/s");
            self.broken("limits.standstill-mm-per-s", &["limits.velocity-mm-per-s"], title, label);
        }
        self.counts();
    }

    /// A speed that is still taken for motion must not carry an encoder half way around its counter
    /// between two samples that may be borne apart.
    fn counts(&self) {
        let supervision = &self.machine.supervision;
        let periods = f64::from(supervision.stale_cycles_max.max(supervision.pause_cycles_max)) + 1.0;
        let between_s = periods * self.machine.cycle.period.as_s();
        let (sheet, lead_mm) = (&self.axis.sheet, self.axis.plant.mechanics.lead_m * 1e3);
        let motor_per_mm = f64::from(sheet.motor_counts_per_rev) / lead_mm;
        let encoders = [
            (motor_per_mm, "motor-encoder.counts-per-rev"),
            (f64::from(sheet.table_counts_per_mm), "table-scale.counts-per-mm"),
        ];
        let velocity = self.axis.control.limits.velocity.as_mm_per_s();
        for (counts_per_mm, encoder) in encoders {
            let fastest = COUNTS_BETWEEN_SAMPLES_MAX / (JUMP_FACTOR * between_s * counts_per_mm);
            if velocity > fastest {
                let title = format!(
                    "{} mm/s is too fast for {}: {JUMP_FACTOR} times it wraps the counter",
                    rounded(velocity),
                    (self.key)(encoder)
                );
                let label = format!("allowed is 0.01 to {fastest:.2} mm/s");
                let others = [
                    encoder,
                    "mechanics.lead-mm",
                    "cycle.period-us",
                    "supervision.stale-cycles-max",
                    "supervision.pause-cycles-max",
                    "board.sheet",
                ];
                self.broken("limits.velocity-mm-per-s", &others, title, label);
            }
        }
    }

    /// What the whole machine does must be within the limits of each axis.
    fn shared(&self) {
        let (motion, limits) = (&self.machine.motion, &self.axis.control.limits);
        if motion.positioning_feed > limits.velocity {
            let [feed, limit] =
                [motion.positioning_feed, limits.velocity].map(|v| rounded(v.as_mm_per_min()));
            let title = format!("{feed} mm/min is above {}", (self.key)("limits.velocity-mm-per-s"));
            let label = format!("allowed is 1 to {limit} mm/min");
            self.broken("motion.positioning-feed-mm-per-min", &["limits.velocity-mm-per-s"], title, label);
        }
        let path = motion.path_acceleration;
        if path > limits.acceleration {
            let title = format!("{path} is above {}", (self.key)("limits.acceleration-m-per-s2"));
            let label = format!("allowed is 0.001 to {}", limits.acceleration);
            self.broken("motion.path-acceleration-m-per-s2", &["limits.acceleration-m-per-s2"], title, label);
        }
        let stop_ms = limits.velocity.as_m_per_s() / path.as_m_per_s2() * 1e3;
        let patience_ms = self.machine.supervision.patience.stopping.as_us() * 1e-3;
        if stop_ms > patience_ms {
            let title = format!(
                "{patience_ms} ms is over before {} is braked off at {path}",
                (self.key)("limits.velocity-mm-per-s")
            );
            let label = format!("allowed is {:.0} ms or more", stop_ms.ceil());
            let others = ["limits.velocity-mm-per-s", "motion.path-acceleration-m-per-s2"];
            self.broken("supervision.stop-timeout-ms", &others, title, label);
        }
    }
}

/// Whether a path is that of a section of the whole machine.
fn is_shared(path: &str) -> bool {
    ["cycle.", "bus.", "supervision.", "motion."].iter().any(|section| path.starts_with(section))
}

fn ampere(milli: u32) -> f64 {
    f64::from(milli) * 1e-3
}

/// For a reader: without the last digits that a change of unit leaves.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}
