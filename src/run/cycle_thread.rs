//! The thread of the cycle: prepared and rehearsed first, given its work when the verdict is in.
//!
//! It is one thread throughout, so what was rehearsed is what runs.
//! Invariant: without work it ends, and has touched no bus.

use std::io;
use std::sync::mpsc::{self, Sender};
use std::thread::{Builder, JoinHandle};

use crate::base::time::Span;
use crate::rt::cycle::pace::{Wall, monotonic_now};
use crate::rt::thread::rehearsal::{Rehearsal, rehearse};
use crate::rt::thread::{Settings, Thread};

/// How long the rehearsal lasts.
const REHEARSAL: Span = Span::ms(250);

type Work<T> = Box<dyn FnOnce() -> T + Send>;

/// A thread that waits for the cycle.
pub struct CycleThread<T> {
    thread: JoinHandle<Option<T>>,
    work: Sender<Work<T>>,
}

impl<T: Send + 'static> CycleThread<T> {
    /// Starts and prepares it, and rehearses its pace: what was obtained, and what was seen.
    pub fn start(settings: Settings, period: Span) -> io::Result<(Self, Thread, Rehearsal)> {
        let (work, offered) = mpsc::channel::<Work<T>>();
        let (report, reported) = mpsc::channel();
        let thread = Builder::new().name("cycle".to_owned()).spawn(move || {
            let prepared = Thread::prepare(&settings);
            let mut pace = Wall::starting_at(monotonic_now() + period, period);
            let rehearsal = rehearse(&mut pace, ((REHEARSAL / period) as u64).max(1));
            report.send((prepared, rehearsal)).ok()?;
            Some((offered.recv().ok()?)())
        })?;
        match reported.recv() {
            Ok((prepared, rehearsal)) => Ok((Self { thread, work }, prepared, rehearsal)),
            Err(_) => Err(thread.join().map_or_else(
                |panic| std::panic::resume_unwind(panic),
                |_none| io::Error::other("the thread of the cycle ended before its work"),
            )),
        }
    }

    /// Gives it its work; `None` comes back only if it was not given any.
    pub fn give(self, work: impl FnOnce() -> T + Send + 'static) -> JoinHandle<Option<T>> {
        // It waits for this and for nothing else; if it is gone, `join` tells why.
        let _taken = self.work.send(Box::new(work));
        self.thread
    }
}
