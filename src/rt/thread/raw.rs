//! The three calls to the system that have no safe wrapper: scheduling policy, its read-back, and the
//! knobs of the allocator. Everything else here goes through `nix`.
//!
//! Invariant: the only `unsafe` of the set-up; no pointer outlives its call.

#![expect(unsafe_code, reason = "neither nix nor rustix has sched_setscheduler, and none has mallopt")]

use nix::errno::Errno;
use nix::libc;

/// How the calling thread is scheduled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scheduling {
    /// Who runs before whom.
    pub policy: Policy,
    /// 1 to 99 under a real-time policy, higher first; 0 under the others.
    pub priority: i32,
    /// Whether what this thread starts is scheduled as usual.
    pub is_reset_on_fork: bool,
}

/// The scheduling policies of Linux.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Real time: runs until it waits or a higher priority comes.
    Fifo,
    /// Real time, in turns among equals.
    RoundRobin,
    /// Shares of time, as everything that asks for nothing.
    Other,
    /// Another one, by its number in the kernel.
    Numbered(i32),
}

/// Asks for SCHED_FIFO for the calling thread. What it starts is not to inherit that.
pub(super) fn set_fifo(priority: u8) -> Result<(), Errno> {
    let parameters = libc::sched_param { sched_priority: i32::from(priority) };
    // SAFETY: 0 is the calling thread; the parameters live until the call returns and are only read.
    let answer = unsafe {
        libc::sched_setscheduler(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, &raw const parameters)
    };
    Errno::result(answer).map(drop)
}

/// How the calling thread is scheduled.
pub(super) fn scheduling() -> Result<Scheduling, Errno> {
    // SAFETY: 0 is the calling thread; nothing is passed by pointer.
    let policy = Errno::result(unsafe { libc::sched_getscheduler(0) })?;
    let mut parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: 0 is the calling thread; the parameters live until the call returns and are ours alone.
    Errno::result(unsafe { libc::sched_getparam(0, &raw mut parameters) })?;
    let is_reset_on_fork = policy & libc::SCHED_RESET_ON_FORK != 0;
    let policy = match policy & !libc::SCHED_RESET_ON_FORK {
        libc::SCHED_FIFO => Policy::Fifo,
        libc::SCHED_RR => Policy::RoundRobin,
        libc::SCHED_OTHER => Policy::Other,
        number => Policy::Numbered(number),
    };
    Ok(Scheduling { policy, priority: parameters.sched_priority, is_reset_on_fork })
}

/// Makes the allocator keep what it once got: never trim the heap, never map a block of its own that
/// would be unmapped when freed, and one arena, so that every thread draws on the same reserve.
/// Whether it took all of that.
pub(super) fn keep_heap() -> bool {
    let settings = [(libc::M_TRIM_THRESHOLD, -1), (libc::M_MMAP_MAX, 0), (libc::M_ARENA_MAX, 1)];
    // SAFETY: numbers go in and a number comes out; glibc takes its own lock.
    settings.into_iter().all(|(knob, value)| unsafe { libc::mallopt(knob, value) } == 1)
}
