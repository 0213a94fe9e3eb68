//! A scenario over a virtual CAN interface, in lock step with the simulated machine at its other end.

use std::collections::VecDeque;
use std::path::Path;

use anyhow::{Context, bail, ensure};

use super::super::live::{PATIENCE, lock_step};
use super::logs::Log;
use super::peer::{Peer, Truth};
use crate::config::scenario::Scenario;
use crate::log::Pace;
use crate::offline::hil::{self, Truths, run_on};
use crate::rt::bus::lockstep::{Lockstep, NoPeer};
use crate::rt::bus::socketcan::{SocketCan, is_virtual};
use crate::sim::truth::BLOCK_CYCLES;

/// Where a scenario is run.
pub(super) struct OnBus<'a> {
    pub(super) interface: &'a str,
    /// The machine runs already.
    pub(super) is_attached: bool,
    pub(super) file: &'a Path,
    pub(super) scenario: &'a Scenario,
}

impl OnBus<'_> {
    /// In lock step: the records of the run in memory.
    pub(super) fn in_lock_step(&self, log: &mut Log) -> anyhow::Result<hil::Outcome> {
        self.ensure_virtual()?;
        self.with_peer(Pace::Virtual, |truth| {
            let mut bus = lock_step(&self.scenario.machine, self.interface)?;
            run_on(self.scenario, &mut bus, &mut Knowledge(truth), |record, inputs| log.put(record, inputs))
        })
    }

    /// Does something with the machine at the other end, which tells the truth unless it is somebody else's.
    pub(super) fn with_peer<T>(
        &self,
        pace: Pace,
        work: impl FnOnce(Option<&mut Truth>) -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        if self.is_attached {
            return work(None);
        }
        let (peer, mut truth) = Peer::start(self.file, self.scenario, self.interface, pace)?;
        match work(Some(&mut truth)) {
            Ok(done) => {
                let said = peer.end(truth)?;
                // A simulator that was slow is not to be taken for a slow host.
                said.lines()
                    .filter(|line| line.starts_with("hil-sim: "))
                    .for_each(|line| eprintln!("{line}"));
                Ok(done)
            }
            Err(error) => Err(peer.failed(error)),
        }
    }

    /// Scenarios are for simulated machines.
    pub(super) fn ensure_virtual(&self) -> anyhow::Result<()> {
        let place = Path::new("/sys/class/net").join(self.interface);
        ensure!(
            place.exists(),
            "there is no interface {}; `ip -brief link` lists those there are",
            self.interface
        );
        ensure!(
            is_virtual(&place, self.interface),
            "{} is not a vcan: a real machine may be at its other end, and scenarios are for simulated ones",
            self.interface
        );
        Ok(())
    }
}

/// The truth of a machine in lock step, or none.
struct Knowledge<'a>(Option<&'a mut Truth>);

impl Truths<Lockstep<SocketCan>> for Knowledge<'_> {
    type Error = anyhow::Error;

    fn learn(
        &mut self,
        bus: &Lockstep<SocketCan>,
        cycle: u64,
        known: &mut VecDeque<hil::Truth>,
    ) -> anyhow::Result<()> {
        if bus.is_peer_lost() {
            bail!(NoPeer { patience: PATIENCE });
        }
        let Some(truth) = &mut self.0 else {
            known.push_back(None);
            return Ok(());
        };
        if (cycle + 1).is_multiple_of(BLOCK_CYCLES) {
            for cycle in cycle + 1 - BLOCK_CYCLES..=cycle {
                let axes = truth.of_cycle(cycle as u32)?;
                // In lock step no SYNC can be missed.
                known.push_back(Some(axes.with_context(|| format!("nothing is told of cycle {cycle}"))?));
            }
        }
        Ok(())
    }
}
