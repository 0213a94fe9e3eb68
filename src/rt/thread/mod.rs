//! Makes the process and its control thread fit for real time, once, before the first cycle.
//!
//! [`Process::prepare`] comes first, while there is one thread; [`Thread::prepare`] runs in the thread
//! that will run the cycle. Each step says what was obtained, or what the system answered; what must be
//! obtained before an axis may move is judged above, in `run/readiness`.
//! Priorities are those of SCHED_FIFO: 1 to 99, higher first.
//! Invariant: what is reported was read back from the system; no step ends the process, and none is
//! undone while it lives.

mod latency;
mod memory;
mod raw;
pub mod rehearsal;

use nix::errno::Errno;
use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::sys::prctl;
use nix::sys::resource::{Resource, UsageWho, getrusage};
use nix::sys::signal::{SigSet, Signal};
use nix::unistd::Pid;

use crate::base::time::Span;

pub use latency::Hold;
pub use memory::{LockRefusal, Memory};
pub use raw::{Policy, Scheduling};

/// What a machine asks of the thread of its cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Priority under SCHED_FIFO.
    pub priority: u8,
    /// The processor it runs on; `None`: any.
    pub cpu: Option<u16>,
}

/// What was obtained for the process. Lives as long as it: with it goes the request not to sleep.
#[derive(Debug)]
pub struct Process {
    /// Heap and locked pages.
    pub memory: Memory,
    /// Processors that stay awake.
    pub awake: Result<Hold, Errno>,
}

impl Process {
    /// Prepares the process; call it before there is a second thread.
    pub fn prepare() -> Self {
        Self { memory: memory::prepare(), awake: latency::hold() }
    }
}

/// What was obtained for a thread.
#[derive(Clone, Copy, Debug)]
pub struct Thread {
    /// What the system answered to SCHED_FIFO.
    pub fifo: Result<(), Errno>,
    /// How the thread is scheduled.
    pub scheduling: Result<Scheduling, Errno>,
    /// What the system answered to the processor that was asked for.
    pub pinned: Result<(), Errno>,
    /// Processors it may run on.
    pub cpus: Result<CpuSet, Errno>,
    /// How much later than asked the system may wake it to save energy.
    pub timer_slack: Result<Span, Errno>,
    /// What the system answered to the wish that signals go to other threads.
    pub signals_blocked: Result<(), Errno>,
}

impl Thread {
    /// Prepares the calling thread.
    pub fn prepare(settings: &Settings) -> Self {
        memory::touch_stack();
        let this = Pid::from_raw(0);
        // Pinned before it has the priority, so that it never keeps another processor busy.
        let pinned = settings.cpu.map_or(Ok(()), |cpu| {
            let mut cpus = CpuSet::new();
            cpus.set(cpu.into())?;
            sched_setaffinity(this, &cpus)
        });
        // A limit that cannot be raised is no error of its own: the next call says whether it matters.
        let _unraised = memory::raise_to_hard_limit(Resource::RLIMIT_RTPRIO);
        let fifo = raw::set_fifo(settings.priority);
        let timer_slack = prctl::set_timerslack(1).and_then(|()| prctl::get_timerslack());
        Self {
            fifo,
            scheduling: raw::scheduling(),
            pinned,
            cpus: sched_getaffinity(this),
            timer_slack: timer_slack.map(|ns| Span::ns(ns.into())),
            signals_blocked: signals_of_others().thread_block(),
        }
    }
}

/// All signals but those that a thread brings upon itself, which end the process at the place.
fn signals_of_others() -> SigSet {
    let mut signals = SigSet::all();
    for own in [Signal::SIGSEGV, Signal::SIGBUS, Signal::SIGFPE, Signal::SIGILL, Signal::SIGTRAP] {
        signals.remove(own);
    }
    signals
}

/// Page faults of one thread since it started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PageFaults {
    /// The page was in memory, but not in the thread's view of it.
    pub minor: i64,
    /// The page was on a disk.
    pub major: i64,
}

impl PageFaults {
    /// Those of the calling thread.
    pub fn of_this_thread() -> Result<Self, Errno> {
        let usage = getrusage(UsageWho::RUSAGE_THREAD)?;
        Ok(Self { minor: usage.minor_page_faults(), major: usage.major_page_faults() })
    }

    /// Those since an earlier count.
    pub const fn since(self, earlier: Self) -> Self {
        Self { minor: self.minor - earlier.minor, major: self.major - earlier.major }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thread of its own, because what is set stays set.
    fn in_a_thread<T: Send>(act: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| scope.spawn(act).join().expect("the thread ends well"))
    }

    #[test]
    fn a_thread_is_scheduled_as_it_reports() {
        let thread = in_a_thread(|| Thread::prepare(&Settings { priority: 37, cpu: None }));
        let scheduling = thread.scheduling.expect("any thread may ask how it is scheduled");
        let wanted = Scheduling { policy: Policy::Fifo, priority: 37, is_reset_on_fork: true };
        match thread.fifo {
            Ok(()) => assert_eq!(scheduling, wanted),
            Err(errno) => {
                assert_eq!(
                    (errno, scheduling.policy),
                    (Errno::EPERM, Policy::Other),
                    "only for the privileged"
                );
            }
        }
    }

    #[test]
    fn what_the_thread_starts_is_scheduled_as_usual() {
        let child = in_a_thread(|| {
            let _thread = Thread::prepare(&Settings { priority: 37, cpu: None });
            in_a_thread(raw::scheduling)
        });
        assert_eq!(child.map(|scheduling| (scheduling.policy, scheduling.priority)), Ok((Policy::Other, 0)));
    }

    #[test]
    fn a_thread_stays_on_its_processor() {
        let first = sched_getaffinity(Pid::from_raw(0)).expect("any thread may ask");
        let cpu = (0..CpuSet::count()).find(|cpu| first.is_set(*cpu) == Ok(true)).expect("it runs somewhere");
        let thread = in_a_thread(|| Thread::prepare(&Settings { priority: 37, cpu: Some(cpu as u16) }));
        let mut only = CpuSet::new();
        only.set(cpu).expect("a processor that exists");
        assert_eq!((thread.pinned, thread.cpus), (Ok(()), Ok(only)));
        assert_eq!(sched_getaffinity(Pid::from_raw(0)), Ok(first), "the others run where they ran");
    }

    #[test]
    fn a_processor_that_is_not_there_is_refused() {
        let last = CpuSet::count() as u16 - 1;
        let thread = in_a_thread(|| Thread::prepare(&Settings { priority: 37, cpu: Some(last) }));
        assert_eq!(thread.pinned, Err(Errno::EINVAL));
        let beyond = in_a_thread(|| Thread::prepare(&Settings { priority: 37, cpu: Some(last + 1) }));
        assert_eq!(beyond.pinned, Err(Errno::EINVAL));
    }

    #[test]
    fn signals_go_to_other_threads() {
        let (thread, blocked) = in_a_thread(|| {
            let thread = Thread::prepare(&Settings { priority: 37, cpu: None });
            (thread, SigSet::thread_get_mask().expect("any thread may ask"))
        });
        assert_eq!(thread.signals_blocked, Ok(()));
        assert!(blocked.contains(Signal::SIGTERM) && blocked.contains(Signal::SIGINT), "{blocked:?}");
        assert!(!blocked.contains(Signal::SIGSEGV), "a broken pointer ends the process at once");
    }

    #[test]
    fn timers_are_not_put_together_to_save_energy() {
        // None at all under a real-time policy, one nanosecond under the others.
        let thread = in_a_thread(|| Thread::prepare(&Settings { priority: 37, cpu: None }));
        let slack = thread.timer_slack.expect("any thread may ask");
        assert!(slack <= Span::ns(1), "{} ns", slack.as_ns());
    }

    #[test]
    fn a_touched_page_counts_as_a_fault() {
        let faults = in_a_thread(|| {
            let before = PageFaults::of_this_thread().expect("any thread may ask");
            // Above what malloc takes from its arena, so these are fresh pages.
            std::hint::black_box(vec![1_u8; 16 << 20].as_mut_slice());
            PageFaults::of_this_thread().expect("any thread may ask").since(before)
        });
        assert!(faults.minor > 0, "{faults:?}");
    }
}
