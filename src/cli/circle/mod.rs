//! `quadrant circle`: a circular test on the simulated machine, or the judgement of one from its log.
//!
//! Everything that can be refused is refused before an axis is enabled: the machine file, the test
//! against travel and limits, the folder and the log. What happens after that is always reported.

pub(super) mod live;
mod report;

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::live::{out_folder, outcome_of, stamp_now, stop_wish, with_losses};
use super::{Outcome, PaceName, machine};
use crate::base::motion::{Circle, Direction};
use crate::base::units::{Position, Velocity};
use crate::config::plan::CircleRequest;
use crate::rt::cycle::procedure::Ending;
use crate::run::Place;

use live::CircleJob;

#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    machine: String,
    /// Gain set of the machine file
    #[arg(long, default_value = "standard", value_name = "NAME")]
    gains: String,
    /// Radius of the circle
    #[arg(long, default_value_t = 150.0, value_name = "MM")]
    radius_mm: f64,
    /// Feed along the circle
    #[arg(long, default_value_t = 2000.0, value_name = "MM/MIN")]
    feed_mm_per_min: f64,
    /// Sense of rotation
    #[arg(long, value_enum, default_value_t = Sense::Both)]
    direction: Sense,
    /// Turns evaluated in each direction
    #[arg(long, default_value_t = 1, value_name = "N")]
    revolutions: u32,
    /// Centre of the circle, X; zero is where the axis stands at start
    #[arg(long, default_value_t = 0.0, value_name = "MM", allow_negative_numbers = true)]
    centre_x_mm: f64,
    /// Centre of the circle, Y
    #[arg(long, default_value_t = 0.0, value_name = "MM", allow_negative_numbers = true)]
    centre_y_mm: f64,
    /// Where the evaluated turns start, counter-clockwise from +X
    #[arg(long, default_value_t = 45.0, value_name = "DEG", allow_negative_numbers = true)]
    start_angle_deg: f64,
    /// As fast as the processor allows, or on the wall clock
    #[arg(long, value_enum, default_value_t = PaceName::Virtual)]
    pace: PaceName,
    /// Seed of everything random: encoder counters at power-on, noise; with --bus, of the friction-free
    /// comparison only
    #[arg(long, default_value_t = 1, value_name = "N")]
    seed: u64,
    /// CAN interface of the machine: with --pace realtime a real or simulated one, in virtual time `hil-sim`
    #[arg(long, value_name = "INTERFACE")]
    bus: Option<String>,
    /// Drive a real machine from a computer that is not fit for real time: at a desk only
    #[arg(long)]
    allow_jitter: bool,
    /// Folder for log and report [default: a new folder under quadrant-out]
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Write the log to this file instead of one in the folder
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Judge the circular test in this log instead of running one
    #[arg(long, value_name = "FILE", conflicts_with_all = [
        "machine", "gains", "radius_mm", "feed_mm_per_min", "direction", "revolutions", "centre_x_mm",
        "centre_y_mm", "start_angle_deg", "pace", "seed", "bus", "allow_jitter", "log",
    ])]
    from: Option<PathBuf>,
    /// Print one JSON object instead of the table
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Sense {
    Cw,
    Ccw,
    Both,
}

impl Arguments {
    fn request(&self) -> CircleRequest {
        let directions = match self.direction {
            Sense::Cw => vec![Direction::Cw],
            Sense::Ccw => vec![Direction::Ccw],
            Sense::Both => vec![Direction::Ccw, Direction::Cw],
        };
        let circle = Circle {
            centre_x: Position::mm(self.centre_x_mm),
            centre_y: Position::mm(self.centre_y_mm),
            radius: Position::mm(self.radius_mm),
            feed: Velocity::mm_per_min(self.feed_mm_per_min),
            direction: directions[0],
            start_angle_rad: self.start_angle_deg.to_radians(),
            revolutions: self.revolutions,
        };
        CircleRequest { gains: self.gains.clone(), circle, directions }
    }
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    if let Some(log) = &arguments.from {
        return report::of_log(log, arguments.out.as_deref(), arguments.json);
    }
    let machine = machine(&arguments.machine)?;
    let request = arguments.request();
    let test = machine.circle_test(&request)?;
    let stamp = stamp_now();
    let folder = out_folder(
        arguments.out.as_deref(),
        &format!("{}-circle-{}-{}", stamp, machine.name, request.gains),
    )?;
    let log = arguments.log.clone().unwrap_or_else(|| folder.join(format!("circle-{}.mcap", stamp)));

    let place =
        Place { pace: arguments.pace.pace(), interface: arguments.bus.as_deref(), seed: arguments.seed };
    let job = CircleJob {
        machine: &machine,
        plant: &machine,
        request: &request,
        test,
        returns: false,
        place: &place,
        allow_jitter: arguments.allow_jitter,
        stop_wish: stop_wish(&place)?,
        log: &log,
        title: "circular test",
    };
    let recording = job.record()?;
    let outcome = match recording.ending {
        Ending::Complete => report::of_recording(&machine, &request, &recording, &folder, arguments.json)?,
        ending @ (Ending::Interrupted | Ending::Faulted(..) | Ending::Refused) => outcome_of(&ending),
    };
    if outcome == Outcome::NotDone {
        eprintln!("the log is kept: {}", recording.log.path.display());
    }
    Ok(with_losses(outcome, &recording.log, recording.lost_records))
}
