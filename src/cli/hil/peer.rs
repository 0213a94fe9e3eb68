//! `hil-sim` as a process of ours, at the other end of a virtual interface: started, listened to, ended.
//!
//! What it tells of its axes comes over its standard output. It ends with this process, however that ends.
//! Invariant: no run leaves one behind, and what it said is shown where it failed.

use std::io::{self, BufReader, Read};
use std::os::fd::AsFd;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::{self, JoinHandle};

use anyhow::{Context, anyhow, ensure};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::super::live::{PATIENCE, joined};
use crate::base::time::Span;
use crate::config::scenario::Scenario;
use crate::log::Pace;
use crate::sim::truth::Told;

/// What the machine tells of its axes, line by line.
pub(super) type Truth = Told<BufReader<Timely>>;

/// The simulated machine.
pub(super) struct Peer {
    child: Child,
    said: Option<JoinHandle<String>>,
}

impl Peer {
    /// Starts it with a scenario; it is ready for a host.
    pub(super) fn start(
        file: &Path,
        scenario: &Scenario,
        interface: &str,
        pace: Pace,
    ) -> anyhow::Result<(Self, Truth)> {
        let own = std::env::current_exe().context("where this program is cannot be told")?;
        let program = own.with_file_name("hil-sim");
        ensure!(
            program.exists(),
            "the simulated machine, {}, is missing: it is built by `cargo build -p hil-sim`, and stands beside {}",
            program.display(),
            own.display()
        );
        let mut child = Command::new(&program)
            .args(["--bus", interface, "--truth", "-", "--parent", &std::process::id().to_string()])
            .args(["--pace", pace_name(pace), "--scenario"])
            .arg(file)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("cannot start {}", program.display()))?;
        let (told, errors) = (child.stdout.take(), child.stderr.take());
        let said = thread::spawn(move || {
            let mut said = String::new();
            // What is no text any more is not shown.
            let _cut = errors.map(|mut errors| errors.read_to_string(&mut said));
            said
        });
        let peer = Self { child, said: Some(said) };
        let told = told.ok_or_else(|| anyhow!("it has no standard output"));
        let truth = told.and_then(|told| {
            Ok(Told::begin(
                BufReader::with_capacity(PIPE_BYTES, Timely::new(told)),
                &scenario.machine.axis_names(),
            )?)
        });
        match truth {
            Ok(truth) => Ok((peer, truth)),
            Err(error) => Err(peer.failed(error)),
        }
    }

    /// Ends it; what it said. On the wall clock it may still tell of a SYNC that nobody judges any more.
    pub(super) fn end(mut self, truth: Truth) -> anyhow::Result<String> {
        let pid = Pid::from_raw(i32::try_from(self.child.id()).context("the number of its process")?);
        // One that has ended already says why by its exit code.
        let _ended = kill(pid, Signal::SIGTERM);
        truth.hear_out()?;
        let status = self.child.wait()?;
        let said = self.said.take().map(joined).unwrap_or_default();
        ensure!(status.success(), "hil-sim: {status}\n{}", said.trim_end());
        Ok(said)
    }

    /// The run has failed: why, and what the machine said.
    pub(super) fn failed(mut self, error: anyhow::Error) -> anyhow::Error {
        self.kill();
        let said = self.said.take().map(joined).unwrap_or_default();
        match said.trim_end() {
            "" => error,
            said => error.context(format!("hil-sim said:\n{said}\n")),
        }
    }

    fn kill(&mut self) {
        // It may have ended by itself.
        let _gone = self.child.kill();
        let _reaped = self.child.wait();
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Many rows at once.
const PIPE_BYTES: usize = 1 << 16;

const fn pace_name(pace: Pace) -> &'static str {
    match pace {
        Pace::Virtual => "virtual",
        Pace::Realtime => "realtime",
    }
}

/// A process is loaded and reads its scenario, on a computer that may be busy.
const START_PATIENCE: Span = Span::ms(20_000);

/// The machine's standard output, waited for no longer than the machine itself.
pub(super) struct Timely {
    out: ChildStdout,
    patience: Span,
}

impl Timely {
    const fn new(out: ChildStdout) -> Self {
        Self { out, patience: START_PATIENCE }
    }
}

impl Read for Timely {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut pipes = [PollFd::new(self.out.as_fd(), PollFlags::POLLIN)];
        let timeout = PollTimeout::try_from(self.patience.as_ns() / 1_000_000).unwrap_or(PollTimeout::NONE);
        if poll(&mut pipes, timeout)? == 0 {
            return Err(io::Error::new(io::ErrorKind::TimedOut, "hil-sim is silent"));
        }
        self.patience = PATIENCE;
        self.out.read(buffer)
    }
}
