//! What is simulated: a machine, and a script of what goes wrong with it.

use std::fmt;
use std::path::Path;

use quadrant::base::time::Moment;
use quadrant::config::scenario::load_scenario;
use quadrant::config::{self, LoadError, Machine};
use quadrant::sim::live_rack::LiveRack;
use quadrant::sim::rack::Rack;
use quadrant::sim::script::{Effect, Script};

/// A machine with its script.
pub(crate) struct Simulated {
    pub(crate) machine: Machine,
    script: Script,
    scenario: Option<String>,
}

impl Simulated {
    /// A machine in which nothing goes wrong.
    pub(crate) fn of_machine(name_or_path: &str, seed: u64) -> Result<Self, LoadError> {
        let script = Script { seed, ..Script::default() };
        Ok(Self { machine: config::load(name_or_path)?, script, scenario: None })
    }

    /// The machine of a scenario.
    pub(crate) fn of_scenario(file: &Path) -> Result<Self, LoadError> {
        let scenario = load_scenario(file)?;
        Ok(Self { machine: scenario.machine, script: scenario.script, scenario: Some(scenario.name) })
    }

    /// As at power-on, in virtual time.
    pub(crate) fn rack(&self) -> Rack {
        self.machine.rack(self.script.seed).with_script(&self.script)
    }

    /// The same on the wall clock, with power from a moment on.
    pub(crate) fn live_rack(&self, power_on: Moment) -> LiveRack {
        self.machine.live_rack(self.script.seed, power_on).with_script(&self.script)
    }

    /// Whether the host's own controller fails in the script.
    pub(crate) fn has_controller_fault(&self) -> bool {
        let of_controller =
            |effect: &Effect| matches!(effect, Effect::ControllerBusOff | Effect::ControllerErrorPassive);
        self.script.faults.iter().any(|fault| of_controller(&fault.effect))
    }
}

impl fmt::Display for Simulated {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(scenario) = &self.scenario {
            write!(out, "scenario {scenario}, ")?;
        }
        write!(out, "machine {}, seed {}", self.machine.name, self.script.seed)
    }
}
