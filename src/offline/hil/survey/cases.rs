//! What the survey tries: every kind of scripted fault, with the severities that make a difference.
//!
//! Invariant: every kind of fault has a case; each case has a name of its own, which seeds its runs.

use crate::base::time::Span;
use crate::base::units::{Current, Position};
use crate::sim::script::{Effect, Frames, Kind, Sends, Traffic, Way};

/// One fault with its severity.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// What happens.
    pub effect: Effect,
    /// How long, for a kind that lasts.
    pub lasts: Span,
    /// How much of it, in words.
    pub how: String,
}

impl Case {
    fn new(effect: Effect, lasts: Span, how: &str) -> Self {
        let duration = format!("{} ms", lasts / Span::ms(1));
        let parts = [how, if lasts == Span::ZERO { "" } else { &duration }];
        let how = parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ");
        Self { effect, lasts, how }
    }

    /// Name of its kind.
    pub const fn fault(&self) -> &'static str {
        self.effect.kind().name()
    }

    /// Whether it happens to one axis, not to the bus as a whole.
    pub fn is_of_axis(&self) -> bool {
        let is_of_all = match self.effect {
            Effect::LostFrames(traffic)
            | Effect::RepeatedFrames(traffic)
            | Effect::ReorderedFrames(traffic)
            | Effect::CorruptedFrames(traffic)
            | Effect::LateFrames { traffic, .. } => matches!(traffic.frames, Frames::All | Frames::Sync),
            _ => false,
        };
        self.effect.kind().has_axis() && !is_of_all
    }
}

/// Every case, in order of the kinds, for a machine of this period.
pub(super) fn cases(period: Span) -> Vec<Case> {
    Kind::ALL.into_iter().flat_map(|kind| of_kind(kind, period)).collect()
}

/// A share of the frames, on the way that they travel.
fn frames(frames: Frames, chance: f64) -> Traffic {
    let way = match frames {
        Frames::All => Way::Both,
        Frames::Sync | Frames::Command => Way::ToBoards,
        Frames::Feedback | Frames::Heartbeat => Way::FromBoards,
    };
    Traffic { way, frames, chance }
}

fn of_kind(kind: Kind, period: Span) -> Vec<Case> {
    let ms = |effect, ms, how: &str| Case::new(effect, Span::ms(ms), how);
    let once = |effect, how: &str| Case::new(effect, Span::ZERO, how);
    let periods = |effect, count, how: &str| Case {
        effect,
        lasts: period * count,
        how: [how, if count == 1 { "one period" } else { "two periods" }].join(""),
    };
    let some_of_all = |effect: fn(Traffic) -> Effect| {
        let part = |chance, how: &str| ms(effect(frames(Frames::All, chance)), 2_000, how);
        vec![part(0.001, "0.1 % of all"), part(0.01, "1 % of all"), part(0.1, "10 % of all")]
    };
    match kind {
        Kind::LostFrames => {
            let lost = |which| Effect::LostFrames(frames(which, 1.0));
            let mut cases = vec![
                periods(lost(Frames::Feedback), 2, "feedback, "),
                ms(lost(Frames::Feedback), 200, "feedback"),
                ms(lost(Frames::Command), 10, "commands"),
                ms(lost(Frames::Command), 200, "commands"),
                periods(lost(Frames::Sync), 2, "SYNC, "),
                ms(lost(Frames::Sync), 200, "SYNC"),
                ms(lost(Frames::Heartbeat), 200, "heartbeats"),
                ms(lost(Frames::Heartbeat), 1_000, "heartbeats"),
            ];
            cases.extend(some_of_all(Effect::LostFrames));
            cases
        }
        Kind::LateFrames => [(Frames::Feedback, "feedback"), (Frames::Command, "commands")]
            .into_iter()
            .flat_map(|(which, name)| {
                [1, 3].map(|count| {
                    let traffic = frames(which, 1.0);
                    let by = period * count;
                    let plural = if count == 1 { "" } else { "s" };
                    let how = format!("{name} by {count} period{plural}");
                    ms(Effect::LateFrames { traffic, by }, 200, &how)
                })
            })
            .collect(),
        Kind::RepeatedFrames => some_of_all(Effect::RepeatedFrames),
        Kind::ReorderedFrames => some_of_all(Effect::ReorderedFrames),
        Kind::CorruptedFrames => {
            let bad = |which, chance| Effect::CorruptedFrames(frames(which, chance));
            vec![
                ms(bad(Frames::Feedback, 0.005), 500, "0.5 % of feedback"),
                ms(bad(Frames::Feedback, 0.05), 500, "5 % of feedback"),
                ms(bad(Frames::Command, 0.005), 500, "0.5 % of commands"),
                ms(bad(Frames::Command, 0.05), 500, "5 % of commands"),
                ms(bad(Frames::Sync, 0.05), 500, "5 % of SYNC"),
            ]
        }
        Kind::EncoderFrozen => [10, 100, 2_000].map(|time| ms(Effect::EncoderFrozen, time, "")).to_vec(),
        Kind::EncoderJump => [2.0, -5.0, 20.0, 200.0, -20_000.0]
            .map(|um| once(Effect::EncoderJump(Position::um(um)), &format!("{um} um")))
            .to_vec(),
        Kind::EncoderError => {
            vec![periods(Effect::EncoderError, 1, ""), ms(Effect::EncoderError, 100, "")]
        }
        Kind::EncoderWrap => {
            vec![once(Effect::EncoderWrap(Position::um(1_000.0)), "1000 um from the start")]
        }
        Kind::SilentBoard => vec![periods(Effect::SilentBoard, 2, ""), ms(Effect::SilentBoard, 200, "")],
        Kind::BoardReset => vec![once(Effect::BoardReset, "")],
        Kind::BoardPowerCycle => vec![once(Effect::BoardPowerCycle, "")],
        Kind::DriveFault => vec![once(Effect::DriveFault(0x2310), "error code 2310h")],
        Kind::CurrentSaturation => [(0.0, 1_000), (0.0, 50), (1.0, 1_000), (2.5, 1_000)]
            .map(|(a, time)| ms(Effect::CurrentSaturation(Current::a(a)), time, &format!("at most {a:.1} A")))
            .to_vec(),
        Kind::BoardBusOff => vec![periods(Effect::BoardBusOff, 1, ""), ms(Effect::BoardBusOff, 100, "")],
        Kind::WrongIdentity => vec![once(Effect::WrongIdentity(0x0403), "product 0403h")],
        Kind::WrongFirmwareConfig => {
            vec![once(Effect::WrongFirmwareConfig { watchdog_us: 40_000 }, "watchdog 40000 us")]
        }
        Kind::Load => {
            [0.5, 3.0].map(|factor| once(Effect::Load(factor), &format!("{factor} times the mass"))).to_vec()
        }
        Kind::Friction => [0.5, 2.0, 5.0]
            .map(|factor| once(Effect::Friction(factor), &format!("{factor} times the friction")))
            .to_vec(),
        Kind::Backlash => {
            [20.0, 200.0].map(|um| once(Effect::Backlash(Position::um(um)), &format!("{um} um"))).to_vec()
        }
        Kind::SecondHost => {
            [(Sends::Sync, "SYNC"), (Sends::Commands, "commands"), (Sends::Both, "SYNC and commands")]
                .map(|(sends, how)| ms(Effect::SecondHost(sends), 100, how))
                .to_vec()
        }
        Kind::ControllerBusOff => {
            vec![periods(Effect::ControllerBusOff, 1, ""), ms(Effect::ControllerBusOff, 100, "")]
        }
        Kind::ControllerErrorPassive => vec![ms(Effect::ControllerErrorPassive, 100, "")],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_a_case_and_each_case_a_name_of_its_own() {
        let cases = cases(Span::us(500));
        for kind in Kind::ALL {
            assert!(cases.iter().any(|case| case.effect.kind() == kind), "{} is not tried", kind.name());
        }
        let names: std::collections::BTreeSet<_> =
            cases.iter().map(|case| (case.fault(), case.how.as_str())).collect();
        assert_eq!(names.len(), cases.len());
    }

    #[test]
    fn the_period_is_what_is_one_period() {
        let [fast, slow] = [500, 1_000].map(|us| cases(Span::us(us)));
        for (fast, slow) in fast.iter().zip(&slow) {
            assert_eq!((fast.fault(), &fast.how), (slow.fault(), &slow.how));
        }
        let lasts = |cases: &[Case]| {
            let case = cases.iter().find(|case| case.effect.kind() == Kind::BoardBusOff);
            case.map(|case| case.lasts)
        };
        assert_eq!((lasts(&fast), lasts(&slow)), (Some(Span::us(500)), Some(Span::us(1_000))));
    }
}
