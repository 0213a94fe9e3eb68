//! From a checked machine to the settings of those who run it: cycle, drives, simulated rack.
//!
//! Invariant: what control believes of an axis and what is simulated of it are two values
//! ([`Machine::axes`]: `control.axis` and `plant`); they are equal only by choice.

use super::Machine;
use crate::base::axis::PerAxis;
use crate::base::time::Moment;
use crate::rt::bus::Id;
use crate::rt::control;
use crate::rt::cycle;
use crate::rt::drive::{Configuring, DriveSettings, Drives, SettingsError};
use crate::rt::wire::{Address, Layout};
use crate::sim::live_rack::LiveRack;
use crate::sim::rack::{self, Rack};

impl Machine {
    /// Settings of the cycle.
    pub fn cycle_settings(&self) -> cycle::Settings {
        cycle::Settings {
            position_every: self.cycle.position_every,
            reply_window: self.cycle.reply_window,
            stale_cycles_max: self.supervision.stale_cycles_max,
            heartbeat_timeout: self.supervision.heartbeat_timeout,
            patience: self.supervision.patience,
            pause_cycles_max: self.supervision.pause_cycles_max,
            overruns: self.supervision.overruns,
            losses: self.supervision.losses,
            stop_acceleration: self.motion.path_acceleration,
        }
    }

    /// Settings of the loops.
    pub fn control_settings(&self) -> PerAxis<control::Settings> {
        self.axes.map(|_, axis| axis.control)
    }

    /// Drives to be commissioned.
    pub fn drives(&self) -> Result<Drives<Configuring>, SettingsError> {
        let drives = self.axes.map(|_, axis| DriveSettings {
            node: axis.node,
            layout: self.bus.layout,
            sheet: axis.sheet,
            serial: None,
            scale: axis.scale,
            velocity_estimate: axis.velocity_estimate,
        });
        Drives::new(self.cycle.period, drives)
    }

    /// Identifiers of all frames of its protocol: those of the boards, and those of a host, so that a
    /// second one is seen.
    pub fn identifiers(&self) -> Vec<Id> {
        let of_node = |node| {
            [
                Address::Emergency(node),
                Address::Feedback(node),
                Address::FeedbackTable(node),
                Address::Command(node),
                Address::ParameterReply(node),
                Address::ParameterRequest(node),
                Address::Heartbeat(node),
            ]
        };
        let boards = self.axes.as_slice().iter().flat_map(|axis| of_node(axis.node));
        std::iter::once(Address::Sync).chain(boards).map(Address::id).collect()
    }

    /// Whether there are FD frames among them.
    pub fn is_fd(&self) -> bool {
        self.bus.layout == Layout::Fd
    }

    /// The machine to be simulated in virtual time.
    pub fn rack(&self, seed: u64) -> Rack {
        Rack::new(self.cycle.period, &self.rack_settings(), seed)
    }

    /// The machine to be simulated on the wall clock, with power from a moment on.
    pub fn live_rack(&self, seed: u64, power_on: Moment) -> LiveRack {
        LiveRack::new(self.cycle.period, &self.rack_settings(), seed, power_on)
    }

    fn rack_settings(&self) -> PerAxis<rack::AxisSettings> {
        self.axes.map(|_, axis| rack::AxisSettings {
            node: axis.node,
            layout: self.bus.layout,
            sheet: axis.sheet,
            scale: axis.scale,
            feedback_latency: axis.feedback_latency,
            current_noise: axis.current_noise,
            plant: axis.plant,
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::config;

    #[test]
    fn identifiers_are_those_of_the_nodes_and_of_a_host_each_once() {
        for (name, is_fd) in [("reference", true), ("classic", false)] {
            let machine = config::load(name).unwrap();
            assert_eq!(machine.is_fd(), is_fd);
            let mut ids: Vec<u16> = machine.identifiers().iter().map(|id| id.raw()).collect();
            ids.sort_unstable();
            let of_node =
                |node: u16| [0x080, 0x180, 0x200, 0x280, 0x580, 0x600, 0x700].map(|function| function + node);
            let mut expected = [&[0x080][..], &of_node(1), &of_node(2)].concat();
            expected.sort_unstable();
            assert_eq!(ids, expected, "{name}");
        }
    }
}
