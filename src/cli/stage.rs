//! The machine of a verb that moves axes and learns from it, and what stands behind its boards.
//!
//! Invariant: the same options with the same words for every such verb.

use std::io::{IsTerminal, Write};

use anyhow::bail;
use clap::Args;

use super::live::moves_a_machine;
use super::{PaceName, machine};
use crate::config::Machine;
use crate::log::Pace;
use crate::run::Place;

/// Which machine, where it is, and what is known of it beforehand.
#[derive(Debug, Args)]
pub(super) struct StageArguments {
    /// Machine file, or an embedded machine: reference, paper, classic
    #[arg(long, default_value = "reference", value_name = "FILE|NAME")]
    pub(super) machine: String,
    /// CAN interface of the machine: with --pace realtime a real or simulated one, in virtual time `hil-sim`;
    /// without, the machine is simulated in this process
    #[arg(long, value_name = "INTERFACE")]
    bus: Option<String>,
    /// As fast as the processor allows, or on the wall clock
    #[arg(long, value_enum, default_value_t = PaceName::Virtual)]
    pace: PaceName,
    /// Simulate the axes of this machine file behind the boards: what the machine file does not know of
    #[arg(long, value_name = "FILE|NAME", conflicts_with = "bus")]
    plant: Option<String>,
    /// Drive a real machine from a computer that is not fit for real time: at a desk only
    #[arg(long)]
    pub(super) allow_jitter: bool,
}

/// How well forces are known, which all come from a current.
#[derive(Debug, Args)]
pub(super) struct ForceArguments {
    /// How far the torque constant may be off, as half a 95 % interval: a term of its own in every force
    #[arg(long, value_name = "PERCENT", default_value_t = 5.0, value_parser = percent,
          allow_negative_numbers = true)]
    pub(super) torque_constant_tolerance_percent: f64,
}

impl StageArguments {
    /// The machine of the file, and the one behind the boards: the same, unless another was named.
    pub(super) fn machines(&self) -> anyhow::Result<[Machine; 2]> {
        let of_file = machine(&self.machine)?;
        let Some(name) = &self.plant else { return Ok([of_file.clone(), of_file]) };
        let plant = machine(name)?;
        if plant.axes.count() != of_file.axes.count() || plant.cycle.period != of_file.cycle.period {
            bail!(
                "--plant {name}: {} axes every {} us, machine {} has {} every {} us",
                plant.axes.count(),
                plant.cycle.period.as_us(),
                of_file.name,
                of_file.axes.count(),
                of_file.cycle.period.as_us()
            );
        }
        Ok([of_file, plant])
    }

    /// Where the machine is; what is random in a simulated one has this seed.
    pub(super) fn place(&self, seed: u64) -> Place<'_> {
        Place { pace: self.pace.pace(), interface: self.bus.as_deref(), seed }
    }
}

/// Whether the person at the terminal lets a real machine move; where none moves, or `yes` was said, nobody is asked.
///
/// # Errors
/// When there is nobody to ask.
pub(super) fn may_move(place: &Place<'_>, yes: bool) -> anyhow::Result<bool> {
    if yes || !moves_a_machine(place) {
        return Ok(true);
    }
    if !std::io::stdin().is_terminal() {
        bail!("refused to move a machine unasked: there is no terminal to ask at; --yes says yes beforehand");
    }
    eprint!("Is the travel free, and somebody at the emergency stop? Type yes to start: ");
    std::io::stderr().flush()?;
    let mut answer = String::new();
    std::io::stdin().read_line(&mut answer)?;
    let may = answer.trim() == "yes";
    if !may {
        eprintln!("nothing was moved");
    }
    Ok(may)
}

/// Where a machine is, in words.
pub(super) fn whereabouts(place: &Place<'_>) -> String {
    match (place.interface, place.pace) {
        (None, _) => "simulated in this process".to_owned(),
        (Some(interface), Pace::Virtual) => format!("simulated behind {interface}"),
        (Some(interface), Pace::Realtime) => format!("behind {interface}: real axes may move"),
    }
}

/// A share that is a number from 0 to 50 %.
fn percent(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.0..=50.0).contains(&value) => Ok(value),
        Ok(_) | Err(_) => Err("wanted is a number from 0 to 50 (%)".to_owned()),
    }
}
