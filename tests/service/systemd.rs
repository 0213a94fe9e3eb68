//! What the supervisor hears, on a socket of its own as systemd has one.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::net::UnixDatagram;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use nix::sys::ptrace;
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitPidFlag, WaitStatus, waitpid};
use nix::unistd::Pid;
use tempfile::TempDir;

use crate::daemon;

/// Longest silence that the supervisor bears: looked at every 150 ms.
const PATIENCE: Duration = Duration::from_millis(300);
/// Until something that must come has come, also on a busy machine.
const SOON: Duration = Duration::from_secs(20);

/// A daemon with a supervisor that listens.
struct Supervised {
    daemon: Child,
    socket: UnixDatagram,
    folder: TempDir,
}

impl Supervised {
    fn start(patience: Option<Duration>) -> Self {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        let mut command = Command::new(daemon());
        command.arg("--logs").arg(folder.path().join("logs")).stderr(Stdio::null());
        command.env("NOTIFY_SOCKET", &path).env_remove("WATCHDOG_USEC").env_remove("WATCHDOG_PID");
        if let Some(patience) = patience {
            command.env("WATCHDOG_USEC", patience.as_micros().to_string());
        }
        Self { daemon: command.spawn().unwrap(), socket, folder }
    }

    /// The next message, if one comes in time.
    fn hear(&self, within: Duration) -> Option<String> {
        let mut bytes = [0; 1024];
        self.socket.set_read_timeout(Some(within)).unwrap();
        match self.socket.recv(&mut bytes) {
            Ok(count) => Some(String::from_utf8(bytes[..count].to_vec()).unwrap()),
            Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => None,
            Err(error) => panic!("{error}"),
        }
    }

    /// Everything said until one of `words` comes, which must be soon.
    fn hear_until(&self, words: &str) -> Vec<String> {
        let (start, mut heard) = (Instant::now(), Vec::new());
        while start.elapsed() < SOON {
            if let Some(message) = self.hear(SOON) {
                let is_it = message.contains(words);
                heard.push(message);
                if is_it {
                    return heard;
                }
            }
        }
        panic!("no {words} in {heard:?}");
    }

    fn pid(&self) -> Pid {
        Pid::from_raw(self.daemon.id() as i32)
    }

    /// The thread of the cycle.
    fn cycle_thread(&self) -> Pid {
        let tasks = fs::read_dir(format!("/proc/{}/task", self.pid())).unwrap();
        let is_cycle = |name: &String| {
            let comm = fs::read_to_string(format!("/proc/{}/task/{name}/comm", self.pid()));
            comm.is_ok_and(|comm| comm.trim() == "cycle")
        };
        let name = tasks.map(|task| task.unwrap().file_name().into_string().unwrap()).find(is_cycle);
        Pid::from_raw(name.expect("the daemon has a thread `cycle`").parse().unwrap())
    }
}

impl Drop for Supervised {
    fn drop(&mut self) {
        // Only if the test went wrong; else it has ended.
        let _gone = self.daemon.kill();
        let _reaped = self.daemon.wait();
    }
}

/// A thread that stands still as under a debugger, while the rest of its process goes on.
struct Halted(Pid);

impl Halted {
    fn new(thread: Pid) -> Self {
        ptrace::seize(thread, ptrace::Options::empty()).unwrap();
        let halted = Self(thread);
        ptrace::interrupt(thread).unwrap();
        let status = waitpid(thread, Some(WaitPidFlag::__WALL)).unwrap();
        assert!(matches!(status, WaitStatus::PtraceEvent(..) | WaitStatus::Stopped(..)), "{status:?}");
        halted
    }
}

impl Drop for Halted {
    fn drop(&mut self) {
        // A thread that is gone needs no letting go.
        let _gone = ptrace::detach(self.0, None);
    }
}

#[test]
fn the_supervisor_hears_ready_life_and_stopping() {
    let start = Instant::now();
    let mut run = Supervised::start(Some(PATIENCE));
    let heard = run.hear_until("READY=1");
    assert_eq!(heard.len(), 1, "nothing is said before: {heard:?}");
    let logs = fs::read_dir(run.folder.path().join("logs")).unwrap().count();
    assert_eq!(logs, 1, "ready means that the cycle runs and is logged");
    let first = run.hear_until("WATCHDOG=1").pop().unwrap();
    assert!(first.contains("STATUS=") && first.contains("cycles/s, latest wake-up"), "{first}");
    (0..4).for_each(|_| drop(run.hear_until("WATCHDOG=1")));
    let elapsed = start.elapsed();
    assert!(elapsed >= 5 * PATIENCE / 2, "five signs of life in {elapsed:?}: more often than asked for");
    kill(run.pid(), Signal::SIGTERM).unwrap();
    let heard = run.hear_until("STOPPING=1");
    assert_eq!(run.daemon.wait().unwrap().code(), Some(0), "{heard:?}");
    assert_eq!(run.hear(Duration::from_millis(1)), None, "nothing is said after it");
}

#[test]
fn a_cycle_that_stands_still_gives_no_sign_of_life() {
    let run = Supervised::start(Some(PATIENCE));
    run.hear_until("WATCHDOG=1");
    let halted = Halted::new(run.cycle_thread());
    // The look under way may still have seen some cycles.
    let heard = run.hear_until("STATUS=0 cycles/s");
    assert!(!heard.last().unwrap().contains("WATCHDOG"), "{heard:?}");
    let start = Instant::now();
    let mut looks = 0;
    while start.elapsed() < 4 * PATIENCE {
        if let Some(message) = run.hear(PATIENCE) {
            assert!(!message.contains("WATCHDOG"), "a sign of life of a dead cycle: {message}");
            looks += 1;
        }
    }
    assert!(looks > 0, "the watch itself goes on");
    drop(halted);
    run.hear_until("WATCHDOG=1");
}

#[test]
fn a_supervisor_without_patience_gets_no_signs_of_life() {
    let mut run = Supervised::start(None);
    run.hear_until("READY=1");
    let heard = run.hear_until("STATUS=");
    assert!(!heard.iter().any(|message| message.contains("WATCHDOG")), "{heard:?}");
    kill(run.pid(), Signal::SIGINT).unwrap();
    run.hear_until("STOPPING=1");
    assert_eq!(run.daemon.wait().unwrap().code(), Some(0));
}
