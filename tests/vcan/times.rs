//! When a frame came, and when waiting ends.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use nix::sys::pthread::{pthread_kill, pthread_self};
use nix::sys::signal::Signal;
use nix::sys::time::TimeSpec;
use nix::time::{ClockId, clock_gettime, clock_settime};
use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::Bus;
use quadrant::rt::bus::socketcan::{Settings, SocketCan};
use quadrant::rt::clock::monotonic_now;

use crate::rig::{Interface, ids, number, numbered, say};

/// What a thread may be late on a busy machine.
const LATE: Span = Span::ms(150);
/// A frame is handed over by a soft interrupt, which may come after the send has returned; it is read far later.
const HANDED_OVER: Span = Span::ms(1);
/// Between two readings of the wall clock it may be slewed.
const SLEW: Span = Span::us(100);

#[test]
fn a_frame_is_dated_when_it_came_not_when_it_was_read() {
    let Some(interface) = Interface::new() else { return };
    let mut other = interface.bus(&[]);
    let origin = monotonic_now();
    let settings = Settings { interface: &interface.name, identifiers: &ids(&[0x181]), is_fd: true };
    let mut host = SocketCan::open(&settings, origin).unwrap();
    let now = || Moment::ZERO + (monotonic_now() - origin);
    let mut spans = Vec::new();
    for count in 0..20 {
        let before = now();
        other.send(&numbered(0x181, count)).unwrap();
        spans.push((before, now()));
        thread::sleep(Duration::from_millis(2));
    }
    for (count, (before, after)) in spans.into_iter().enumerate() {
        let received = host.receive(Moment::ZERO).unwrap();
        assert_eq!(number(&received) as usize, count);
        let at = received.at;
        assert!(
            at >= before - SLEW && at <= after + HANDED_OVER,
            "sent in {before:?} to {after:?}, dated {at:?}"
        );
    }
}

#[test]
fn a_wall_clock_that_is_set_moves_no_frame_out_of_its_bounds() {
    let Some(interface) = Interface::new() else { return };
    if std::env::var_os("QUADRANT_VCAN_CLOCK").is_none_or(|clock| clock != "own") {
        say("SKIPPED, the wall clock is not this test's to set: it is in a guest (with-vcan --guest)");
        return;
    }
    let wall = ClockId::CLOCK_REALTIME;
    let set = |by_s: i64| {
        let now = clock_gettime(wall).unwrap();
        clock_settime(wall, TimeSpec::new(now.tv_sec() + by_s, now.tv_nsec())).unwrap();
    };
    let (mut host, mut other) = (interface.bus(&[0x181]), interface.bus(&[]));
    for by_s in [3_600, -7_200, 3_600] {
        let empty = monotonic_now();
        assert_eq!(host.receive(empty), None, "nothing has come by now");
        thread::sleep(Duration::from_millis(20));
        other.send(&numbered(0x181, 1)).unwrap();
        thread::sleep(Duration::from_millis(20));
        set(by_s);
        let at = host.receive(Moment::ZERO).map(|received| received.at);
        let now = monotonic_now();
        assert!(
            at >= Some(empty) && at <= Some(now),
            "{at:?}, came in {empty:?} to {now:?}, set by {by_s} s"
        );
    }
}

#[test]
fn another_origin_counts_for_what_is_handed_out_from_then_on() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut other) = (interface.bus(&[0x181]), interface.bus(&[]));
    other.send_all(&[numbered(0x181, 0), numbered(0x181, 1)]).unwrap();
    let first = host.receive(monotonic_now() + Span::s(5.0)).unwrap();
    host.set_origin(Moment::ZERO + Span::s(1.0));
    let second = host.receive(first.at).unwrap();
    let apart = first.at - second.at;
    assert!(apart <= Span::s(1.0) && apart > Span::s(1.0) - LATE, "{apart:?} apart, both just sent");
}

#[test]
fn waiting_ends_at_the_deadline() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[0x181]);
    for wait in [Span::us(300), Span::ms(5), Span::ms(40)] {
        let deadline = monotonic_now() + wait;
        assert_eq!(host.receive(deadline), None);
        let over = monotonic_now() - deadline;
        assert!(over >= Span::ZERO && over < LATE, "{} us after the deadline", over.as_us());
    }
}

#[test]
fn a_signal_does_not_shorten_the_wait() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[0x181]);
    let came = std::sync::Arc::new(AtomicBool::new(false));
    let signal = Signal::SIGUSR1;
    signal_hook::flag::register(signal as i32, std::sync::Arc::clone(&came)).unwrap();
    let waiter = pthread_self();
    let deadline = monotonic_now() + Span::ms(60);
    let interrupter = thread::spawn(move || {
        for _ in 0..10 {
            thread::sleep(Duration::from_millis(3));
            pthread_kill(waiter, signal).unwrap();
        }
    });
    assert_eq!(host.receive(deadline), None);
    let over = monotonic_now() - deadline;
    interrupter.join().unwrap();
    assert!(came.load(Ordering::Relaxed), "no signal came");
    assert!(over >= Span::ZERO && over < LATE, "{} us after the deadline", over.as_us());
}

#[test]
fn a_frame_ends_the_wait_and_after_the_deadline_what_is_there_still_comes() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut other) = (interface.bus(&[0x181]), interface.bus(&[]));
    let sender = thread::spawn(move || {
        thread::sleep(Duration::from_millis(10));
        other.send_all(&[numbered(0x181, 1), numbered(0x181, 2), numbered(0x181, 3)]).unwrap();
    });
    let began = monotonic_now();
    assert_eq!(host.receive(began + Span::s(10.0)).map(|r| number(&r)), Some(1));
    let waited = monotonic_now() - began;
    assert!(waited < Span::ms(10) + LATE, "{} us", waited.as_us());
    sender.join().unwrap();
    let past = began - Span::s(1.0);
    let rest: Vec<u32> = std::iter::from_fn(|| host.receive(past)).map(|r| number(&r)).collect();
    assert_eq!(rest, [2, 3]);
}

#[test]
fn a_round_trip_between_two_threads_is_short() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut board) = (interface.bus(&[0x181]), interface.bus(&[0x080]));
    const ROUNDS: u32 = 5_000;
    let echo = thread::spawn(move || {
        for _ in 0..ROUNDS {
            let received = board.receive(monotonic_now() + Span::s(5.0)).unwrap();
            board.send(&numbered(0x181, number(&received))).unwrap();
        }
    });
    let mut spans_us: Vec<f64> = (0..ROUNDS)
        .map(|count| {
            let began = monotonic_now();
            host.send(&numbered(0x080, count)).unwrap();
            assert_eq!(host.receive(began + Span::s(5.0)).map(|r| number(&r)), Some(count));
            (monotonic_now() - began).as_us()
        })
        .collect();
    echo.join().unwrap();
    spans_us.sort_by(f64::total_cmp);
    let [p50, p99, max] = [50, 99, 100].map(|percent| spans_us[(spans_us.len() - 1) * percent / 100]);
    say(&format!(
        "round trip of two frames between threads: p50 {p50:.0} us, p99 {p99:.0} us, max {max:.0} us"
    ));
    assert!(p50 < 5_000.0, "p50 {p50} us");
}
