//! The faults of a scenario, each with the keys that its kind has.
//!
//! Names and timing of the kinds are those of [`Kind`]; what each takes beside them stands here once.
//! Invariant: a fault that could not happen is a problem.

use super::super::reader::Section;
use super::{Machine, axis};
use crate::base::time::Span;
use crate::base::units::{Current, Position};
use crate::rt::wire::parameter::Object;
use crate::sim::script::{Effect, Frames, Kind, ScriptedFault, Sends, Timing, Traffic, Way};

/// Latest moment and longest time, s.
const TIME_S_MAX: f64 = 3_600.0;
/// More frames than these are not held back by a line.
const LATE_CYCLES_MAX: i64 = 7;

/// The faults of a scenario, in order of the text.
pub(super) fn read(
    root: &Section<'_>,
    machine: Option<&Machine>,
    duration: Option<Span>,
) -> Vec<ScriptedFault> {
    root.sections("fault").into_iter().map(|section| fault(section, machine, duration)).collect()
}

fn fault(section: Section<'_>, machine: Option<&Machine>, duration: Option<Span>) -> ScriptedFault {
    let kind = section.choice("kind", &Kind::ALL.map(|kind| (kind.name(), kind)));
    let axis = if kind.has_axis() { axis(&section, "axis") } else { None };
    if let Some((axis, machine)) =
        axis.zip(machine).filter(|(axis, machine)| axis.index() >= machine.axes.count())
    {
        let title = format!("machine {} has no axis {axis}", machine.name);
        section.conflict("axis", &[], title, format!("it has {}", machine.axis_names().join(", ")));
    }
    let time = |key: &str, low: f64| Span::s(section.number(key, low..=TIME_S_MAX, "s"));
    let (at, lasts) = match kind.timing() {
        Timing::Start => (Span::ZERO, Span::ZERO),
        Timing::Moment => (time("at-s", 0.0), Span::ZERO),
        Timing::Lasting => (time("at-s", 0.0), time("for-s", 1e-4)),
    };
    if let Some(duration) = duration.filter(|duration| at > *duration) {
        let title = format!("{} s is after the motion", at.as_s());
        section.conflict("at-s", &[], title, format!("the motion takes {:.3} s", duration.as_s()));
    }
    let effect = effect(&section, kind, machine);
    section.close();
    ScriptedFault { at, lasts, axis, effect }
}

fn effect(section: &Section<'_>, kind: Kind, machine: Option<&Machine>) -> Effect {
    let um = |key: &str, low: f64, high: f64| Position::um(section.number(key, low..=high, "um"));
    match kind {
        Kind::LostFrames => Effect::LostFrames(traffic(section)),
        Kind::LateFrames => {
            let cycles = section.whole("late-cycles", 1..=LATE_CYCLES_MAX, "cycles");
            let period = machine.map_or(Span::ZERO, |machine| machine.cycle.period);
            Effect::LateFrames { traffic: traffic(section), by: period * cycles }
        }
        Kind::RepeatedFrames => Effect::RepeatedFrames(traffic(section)),
        Kind::ReorderedFrames => Effect::ReorderedFrames(traffic(section)),
        Kind::CorruptedFrames => Effect::CorruptedFrames(traffic(section)),
        Kind::EncoderFrozen => Effect::EncoderFrozen,
        Kind::EncoderJump => Effect::EncoderJump(um("jump-um", -1e6, 1e6)),
        Kind::EncoderError => Effect::EncoderError,
        Kind::EncoderWrap => Effect::EncoderWrap(um("wraps-after-um", 0.0, 1e6)),
        Kind::SilentBoard => Effect::SilentBoard,
        Kind::BoardReset => Effect::BoardReset,
        Kind::BoardPowerCycle => Effect::BoardPowerCycle,
        Kind::DriveFault => Effect::DriveFault(section.whole("error-code", 1..=0xFFFF, "") as u16),
        Kind::CurrentSaturation => {
            Effect::CurrentSaturation(Current::a(section.number("max-a", 0.0..=2_000.0, "A")))
        }
        Kind::BoardBusOff => Effect::BoardBusOff,
        Kind::WrongIdentity => {
            Effect::WrongIdentity(section.whole("product", 0..=i64::from(u32::MAX), "") as u32)
        }
        Kind::WrongFirmwareConfig => {
            let range = Object::Watchdog.range();
            let range = i64::from(*range.start())..=i64::from(*range.end());
            Effect::WrongFirmwareConfig { watchdog_us: section.whole("watchdog-us", range, "us") as u32 }
        }
        Kind::Load => Effect::Load(section.number("factor", 0.01..=100.0, "")),
        Kind::Friction => Effect::Friction(section.number("factor", 0.0..=100.0, "")),
        Kind::Backlash => Effect::Backlash(um("backlash-um", 0.0, 1_000.0)),
        Kind::SecondHost => {
            Effect::SecondHost(section.choice(
                "sends",
                &[("sync", Sends::Sync), ("commands", Sends::Commands), ("both", Sends::Both)],
            ))
        }
        Kind::ControllerBusOff => Effect::ControllerBusOff,
        Kind::ControllerErrorPassive => Effect::ControllerErrorPassive,
    }
}

fn traffic(section: &Section<'_>) -> Traffic {
    let traffic = Traffic {
        way: section.choice(
            "way",
            &[("from-boards", Way::FromBoards), ("to-boards", Way::ToBoards), ("both", Way::Both)],
        ),
        frames: section.choice(
            "frames",
            &[
                ("all", Frames::All),
                ("sync", Frames::Sync),
                ("command", Frames::Command),
                ("feedback", Frames::Feedback),
                ("heartbeat", Frames::Heartbeat),
            ],
        ),
        chance: section.number("chance", 0.0..=1.0, ""),
    };
    if !traffic.is_from_boards() && !traffic.is_to_boards() {
        section.conflict("frames", &["way"], "does not travel on this way", "SYNC and command go to boards");
    }
    traffic
}
