//! Interfaces that cannot be used, go down, or vanish and come back.

use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::socketcan::{OpenError, SEARCH_INTERVAL, Settings, SocketCan};
use quadrant::rt::bus::{Bus, Frame, Id, SendError};
use quadrant::rt::clock::monotonic_now;

use crate::rig::{Interface, drain, ids, numbered, say};

fn refusal(interface: &str, is_fd: bool) -> OpenError {
    let settings = Settings { interface, identifiers: &ids(&[0x181]), is_fd };
    SocketCan::open(&settings, Moment::ZERO).expect_err("it cannot be opened")
}

#[test]
fn a_kernel_without_can_is_told_from_an_unknown_name() {
    // Needs a kernel without CAN, so it runs where the other tests do not.
    if std::env::var_os("QUADRANT_VCAN").is_some() {
        return;
    }
    match refusal("vcan0", true) {
        OpenError::NoCan => {}
        OpenError::Missing { .. } => say("SKIPPED, this kernel has CAN: a_kernel_without_can"),
        other => panic!("{other}"),
    }
}

#[test]
fn what_is_wrong_with_an_interface_is_said_with_what_to_do() {
    let Some(interface) = Interface::new() else { return };
    let name = interface.name.as_str();
    let cases: [(OpenError, &[&str]); 2] = [
        (refusal("can77", true), &["there is no interface can77", "ip -brief link"]),
        (refusal("lo", true), &["interface lo is not a CAN interface"]),
    ];
    let says = |error: &OpenError, parts: &[&str]| {
        let said = error.to_string();
        parts.iter().for_each(|part| assert!(said.contains(part), "does not say `{part}`: {said}"));
    };
    cases.iter().for_each(|(error, parts)| says(error, parts));
    interface.down();
    says(&refusal(name, true), &[&format!("interface {name} is down"), &format!("ip link set {name} up")]);
    interface.remove();
    interface.make(16);
    says(&refusal(name, true), &["MTU 16", "72", "fd on", name]);
    let settings = Settings { interface: name, identifiers: &[], is_fd: false };
    assert!(SocketCan::open(&settings, Moment::ZERO).is_ok(), "classic frames need no more than 16");
}

#[test]
fn an_interface_that_was_down_serves_again_on_the_same_socket() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut board) = (interface.bus(&[0x181]), interface.bus(&[0x201]));
    for round in 0..3 {
        interface.down();
        assert_eq!(host.send(&numbered(0x201, 99)), Err(SendError::Down));
        let [one, two] = [1, 2].map(|number| Frame::fd(Id::from_low_bits(0x201), [number; 12]));
        assert_eq!(host.send_all(&[one, two]), Err(SendError::Down));
        assert_eq!(drain(&mut host), []);
        // Said once by the kernel; from then on a wait is a wait.
        let deadline = monotonic_now() + Span::ms(5);
        assert_eq!(host.receive(deadline), None);
        assert!(monotonic_now() >= deadline, "a down interface must not make the cycle spin");
        interface.up();
        assert_eq!(host.send(&numbered(0x201, round)), Ok(()));
        // The other end is told of the interruption once, too.
        let came: Vec<Frame> =
            drain(&mut board).into_iter().chain(drain(&mut board)).map(|r| r.frame).collect();
        assert_eq!(came, [numbered(0x201, round)]);
        assert_eq!(board.send(&numbered(0x181, round)), Ok(()));
        assert_eq!(drain(&mut host).len(), 1);
    }
}

#[test]
fn an_interface_that_was_removed_is_found_again_by_its_name() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[0x181]);
    for round in 0..3 {
        interface.remove();
        assert_eq!(host.send(&numbered(0x201, 0)), Err(SendError::Down));
        let deadline = monotonic_now() + Span::ms(5);
        while host.receive(deadline).is_some() {}
        assert_eq!(host.send(&numbered(0x201, 0)), Err(SendError::Down));
        interface.make(72);
        let mut board = interface.bus(&[0x201]);
        let began = monotonic_now();
        while host.send(&numbered(0x201, round)).is_err() {
            let waited = monotonic_now() - began;
            assert!(waited < SEARCH_INTERVAL + Span::ms(150), "still down after {} us", waited.as_us());
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(drain(&mut board).len(), 1);
        // The kernel forgot the filters with the interface.
        board.send_all(&[numbered(0x182, round), numbered(0x181, round)]).unwrap();
        let came: Vec<Frame> =
            drain(&mut host).into_iter().chain(drain(&mut host)).map(|r| r.frame).collect();
        assert_eq!(came, [numbered(0x181, round)]);
    }
}

#[test]
fn a_host_that_only_listens_finds_its_interface_again() {
    let Some(interface) = Interface::new() else { return };
    let mut host = interface.bus(&[0x181]);
    interface.remove();
    while host.receive(monotonic_now() + Span::ms(5)).is_some() {}
    interface.make(72);
    let mut board = interface.bus(&[]);
    let began = monotonic_now();
    loop {
        board.send(&numbered(0x181, 1)).unwrap();
        if host.receive(monotonic_now() + Span::ms(2)).is_some() {
            break;
        }
        let waited = monotonic_now() - began;
        assert!(waited < SEARCH_INTERVAL + Span::ms(150), "nothing after {} us", waited.as_us());
    }
}

/// Ends a shell with its value.
struct Shell(Child);

impl Drop for Shell {
    fn drop(&mut self) {
        let _gone = self.0.kill();
        let _reaped = self.0.wait();
    }
}

#[test]
fn a_search_beside_others_who_change_interfaces_is_found_to_take_so_long() {
    let (Some(interface), Some(steady)) = (Interface::new(), Interface::new()) else { return };
    let (mut host, mut beside) = (interface.bus(&[0x181]), steady.bus(&[0x181]));
    // Each of these holds the lock that binding a socket wants too.
    let script =
        "while :; do ip link add dev vcan99 type vcan && ip link set vcan99 up; ip link del vcan99; done";
    let others = ["98", "99"].map(|number| {
        let script = script.replace("99", number);
        Shell(Command::new("bash").args(["-c", &script]).stderr(Stdio::null()).spawn().unwrap())
    });
    let mut longest = [Span::ZERO; 2];
    let took = |bus: &mut SocketCan, frame: &Frame| {
        let before = monotonic_now();
        (bus.send(frame), monotonic_now() - before)
    };
    for round in 0..10 {
        interface.remove();
        let mut is_there = false;
        let began = monotonic_now();
        loop {
            if !is_there && monotonic_now() - began > Span::ms(250) {
                interface.make(72);
                is_there = true;
            }
            let (sent, searching) = took(&mut host, &numbered(0x201, round));
            let (_, sending) = took(&mut beside, &numbered(0x201, round));
            longest = [longest[0].max(searching), longest[1].max(sending)];
            if sent.is_ok() && is_there {
                break;
            }
            assert!(monotonic_now() - began < Span::s(5.0), "not found again");
            thread::sleep(Duration::from_millis(1));
        }
    }
    drop(others);
    let [searching, sending] = longest.map(|span| span.as_us() * 1e-3);
    say(&format!(
        "beside others who change interfaces: a call that looks for one took up to {searching:.1} ms, one that \
         does not up to {sending:.1} ms"
    ));
}
