//! The ways in which things go wrong, with what each may cost in time and way.

use std::cell::Cell;

use quadrant::base::fault::Fault;
use quadrant::base::record::BusState;
use quadrant::rt::door::Order;
use quadrant::rt::wire::command::{self, RawCommand};
use quadrant::rt::wire::scaling::{CurrentCounts, TravelCounts};
use quadrant::rt::wire::{Address, Layout, controller};

use super::trouble::{
    GENTLE, RAMP_CYCLES_MAX, RAMP_WAY_MM_MAX, Scenario, Strikes, WATCHDOG_CYCLES_MAX, board, lose, node,
    on_feedback, with_commands,
};
use crate::common::{Fate, X, Y};

pub(crate) fn scenarios() -> Vec<Scenario> {
    vec![
        Scenario {
            name: "board sends nothing",
            break_it: |rig| board(rig).set_silent(true),
            mend_it: |rig| board(rig).set_silent(false),
            ..GENTLE
        },
        Scenario {
            name: "feedback frames lost",
            break_it: |rig| lose(rig, Address::Feedback(node(X))),
            ..GENTLE
        },
        Scenario {
            name: "last frames of each feedback lost",
            break_it: |rig| {
                let last = match rig.machine.bus.layout {
                    Layout::Fd => Address::Feedback(node(X)),
                    Layout::Classic => Address::FeedbackTable(node(X)),
                };
                lose(rig, last);
            },
            ..GENTLE
        },
        Scenario {
            fault: Fault::DriveFault,
            name: "over-current trip of the drive",
            break_it: |rig| board(rig).trip_drive(0x2310, 7),
            ..GENTLE
        },
        Scenario {
            // Nothing stops so short.
            fault: Fault::EncoderJump,
            name: "encoder frozen at speed",
            break_it: |rig| board(rig).set_encoder_frozen(true),
            mend_it: |rig| board(rig).set_encoder_frozen(false),
            cycles_max: 2,
            way_mm_max: 15.0,
            afterwards: Some(Fault::EncoderJump),
            ..GENTLE
        },
        Scenario {
            fault: Fault::NoResponse,
            name: "encoder frozen while the axis creeps",
            strikes: Strikes::Creeping,
            break_it: |rig| board(rig).set_encoder_frozen(true),
            mend_it: |rig| board(rig).set_encoder_frozen(false),
            cycles_max: 15,
            way_mm_max: 0.3,
            // What was not counted is lost.
            afterwards: Some(Fault::NoResponse),
            ..GENTLE
        },
        Scenario {
            fault: Fault::FollowingError,
            name: "motor without torque",
            break_it: |rig| {
                with_commands(rig, |raw| {
                    raw.current = CurrentCounts::ZERO;
                    Fate::Pass
                });
            },
            cycles_max: 400,
            way_mm_max: 20.0,
            ..GENTLE
        },
        Scenario {
            fault: Fault::Travel,
            name: "driven out of its travel",
            // The way to the end at 5 mm is shorter than the axis takes; only the loop's hold is broken.
            // The setpoint is held at 5 mm; a drive that pushes on its own takes the axis out. The ramp
            // does not help against it: at 5 mm from its response the axis loses its current.
            edits: &[
                ("travel-max-mm = 250.0", "travel-max-mm = 5.0"),
                ("travel-margin-mm = 5.0", "travel-margin-mm = 2.0"),
                ("following-error-mm = 1.0", "following-error-mm = 5.0"),
            ],
            break_it: |rig| {
                with_commands(rig, |raw| {
                    raw.current = CurrentCounts::ua(3_000_000);
                    Fate::Pass
                });
            },
            cycles_max: 500,
            way_mm_max: 10.0,
            ..GENTLE
        },
        Scenario {
            fault: Fault::Overspeed,
            name: "drive pushes at 20 A",
            edits: &[("following-error-mm = 1.0", "following-error-mm = 100.0")],
            break_it: |rig| {
                with_commands(rig, |raw| {
                    raw.current = CurrentCounts::ua(20_000_000);
                    Fate::Pass
                });
            },
            cycles_max: 150,
            way_mm_max: 160.0,
            ..GENTLE
        },
        Scenario {
            fault: Fault::Overcurrent,
            name: "drive makes 25 A",
            break_it: |rig| {
                with_commands(rig, |raw| {
                    raw.current = CurrentCounts::ua(25_000_000);
                    Fate::Pass
                });
            },
            cycles_max: 20,
            ..GENTLE
        },
        Scenario {
            fault: Fault::EnableTimeout,
            name: "drive never enables",
            strikes: Strikes::Enabling,
            break_it: |rig| {
                with_commands(rig, |raw| {
                    raw.control_word = 0;
                    Fate::Pass
                });
            },
            cycles_max: 2_010,
            way_mm_max: 1e-6,
            ..GENTLE
        },
        Scenario {
            fault: Fault::HeartbeatLost,
            name: "heartbeats lost",
            break_it: |rig| lose(rig, Address::Heartbeat(node(X))),
            cycles_max: 700 + RAMP_CYCLES_MAX,
            way_mm_max: 40.0 + RAMP_WAY_MM_MAX,
            ..GENTLE
        },
        Scenario {
            fault: Fault::BoardWatchdog,
            name: "commands withheld",
            break_it: |rig| with_commands(rig, |_| Fate::Lost),
            cycles_max: WATCHDOG_CYCLES_MAX,
            ..GENTLE
        },
        Scenario {
            fault: Fault::BoardReset,
            name: "board restarts",
            break_it: |rig| {
                let now = rig.last.timing.scheduled;
                board(rig).reset(now);
            },
            afterwards: Some(Fault::BoardReset),
            ..GENTLE
        },
        Scenario {
            fault: Fault::BoardReset,
            name: "board restarts, its boot-up message is lost",
            break_it: |rig| {
                let now = rig.last.timing.scheduled;
                board(rig).set_silent(true);
                board(rig).reset(now);
                board(rig).set_silent(false);
            },
            afterwards: Some(Fault::BoardReset),
            ..GENTLE
        },
        Scenario {
            fault: Fault::EncoderJump,
            name: "encoder jumps by 25 um",
            break_it: |rig| {
                let counts_per_mm = f64::from(1 << 20) / 10.0;
                board(rig).jump_encoder(TravelCounts::counts((0.025 * counts_per_mm) as i64));
            },
            cycles_max: 2,
            afterwards: Some(Fault::EncoderJump),
            ..GENTLE
        },
        Scenario {
            fault: Fault::EncoderJump,
            name: "board distrusts its encoder",
            break_it: |rig| board(rig).set_encoder_error(true),
            mend_it: |rig| board(rig).set_encoder_error(false),
            afterwards: Some(Fault::EncoderJump),
            ..GENTLE
        },
        Scenario {
            fault: Fault::OtherAxis,
            name: "the other board sends nothing",
            break_it: |rig| rig.line.wired.rack_mut().board_mut(Y).set_silent(true),
            mend_it: |rig| rig.line.wired.rack_mut().board_mut(Y).set_silent(false),
            cycles_max: RAMP_CYCLES_MAX,
            way_mm_max: RAMP_WAY_MM_MAX,
            ..GENTLE
        },
        Scenario {
            fault: Fault::DriveDropped,
            name: "drive told to disable by somebody else",
            break_it: |rig| {
                let once = Cell::new(true);
                with_commands(rig, move |raw| {
                    if once.replace(false) {
                        raw.control_word = 0x07;
                    }
                    Fate::Pass
                });
            },
            ..GENTLE
        },
        Scenario {
            fault: Fault::SendFailed,
            name: "bus refuses commands",
            break_it: |rig| with_commands(rig, |_| Fate::Refused),
            cycles_max: WATCHDOG_CYCLES_MAX,
            ..GENTLE
        },
        Scenario {
            fault: Fault::SendFailed,
            name: "bus refuses SYNC",
            break_it: |rig| {
                // Once: the simulated machine takes its time from the SYNC.
                let once = Cell::new(true);
                rig.line.outgoing = Box::new(move |frame| match Address::of(frame.id()) {
                    Some(Address::Sync) if once.replace(false) => Fate::Refused,
                    _ => Fate::Pass,
                });
            },
            ..GENTLE
        },
        Scenario {
            name: "one feedback frame in seven lost",
            break_it: |rig| {
                on_feedback(rig, |count, _| if count.is_multiple_of(7) { Fate::Lost } else { Fate::Pass });
            },
            // Twenty fit, and one in a hundred cycles drains away.
            cycles_max: 160,
            way_mm_max: 30.0,
            ..GENTLE
        },
        Scenario {
            fault: Fault::BusDown,
            name: "interface down for commands",
            // SYNC goes on: the simulated machine takes its time from it.
            break_it: |rig| with_commands(rig, |_| Fate::Down),
            cycles_max: WATCHDOG_CYCLES_MAX,
            ..GENTLE
        },
        Scenario {
            fault: Fault::BusDown,
            name: "own controller bus-off, and back without a word",
            break_it: |rig| {
                on_feedback(rig, |count, frame| {
                    if count == 1 {
                        *frame = controller::encode(BusState::BusOff);
                    }
                    Fate::Pass
                });
            },
            ..GENTLE
        },
        Scenario {
            fault: Fault::SecondHost,
            name: "another host's SYNC",
            break_it: |rig| {
                on_feedback(rig, |count, frame| {
                    if count == 1 {
                        *frame = command::encode_sync(7);
                    }
                    Fate::Pass
                });
            },
            ..GENTLE
        },
        Scenario {
            fault: Fault::SecondHost,
            name: "another host's command",
            break_it: |rig| {
                let layout = rig.machine.bus.layout;
                on_feedback(rig, move |count, frame| {
                    if count == 1 {
                        *frame = layout.command(node(Y), &RawCommand::default());
                    }
                    Fate::Pass
                });
            },
            ..GENTLE
        },
        Scenario {
            fault: Fault::Overrun,
            name: "9 periods missed at once",
            break_it: |rig| rig.skip(9),
            cycles_max: RAMP_CYCLES_MAX,
            way_mm_max: RAMP_WAY_MM_MAX + 0.5,
            ..GENTLE
        },
        Scenario {
            fault: Fault::Overrun,
            name: "as many periods missed at once as the board's watchdog lets through",
            break_it: |rig| {
                let watchdog = rig.machine.axes[X].sheet.watchdog();
                rig.skip((watchdog.as_ns() / rig.machine.cycle.period.as_ns()) as u64 - 2);
            },
            cycles_max: RAMP_CYCLES_MAX,
            way_mm_max: RAMP_WAY_MM_MAX + 2.0,
            ..GENTLE
        },
        Scenario {
            fault: Fault::Overrun,
            name: "63 periods missed",
            break_it: |rig| {
                // Three at a time, so that feedback comes in between.
                for _ in 0..21 {
                    rig.skip(3);
                    rig.step();
                }
            },
            cycles_max: RAMP_CYCLES_MAX,
            way_mm_max: RAMP_WAY_MM_MAX + 3.0,
            ..GENTLE
        },
        Scenario {
            fault: Fault::StopTimeout,
            name: "stop takes longer than allowed",
            // Long enough for the brake, not for the position loop to run out its lag.
            edits: &[
                ("stop-timeout-ms = 5000", "stop-timeout-ms = 100"),
                ("path-acceleration-m-per-s2 = 0.5", "path-acceleration-m-per-s2 = 5.0"),
            ],
            break_it: |rig| rig.order(Order::Stop),
            cycles_max: 210,
            way_mm_max: RAMP_WAY_MM_MAX,
            ..GENTLE
        },
    ]
}
