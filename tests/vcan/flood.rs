//! More frames than anybody takes, and what a long run takes from the heap.

use std::thread;

use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::{Bus, Frame, Id, SendError};
use quadrant::rt::clock::monotonic_now;

use crate::heap::touched;
use crate::rig::{Interface, drain, network, number, numbered, say};

#[test]
fn what_the_kernel_drops_is_counted_to_the_frame() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut other) = (interface.bus(&[0x181]), interface.bus(&[]));
    let mut sent = 0;
    let mut came = Vec::new();
    for _ in 0..3 {
        for _ in 0..10_000 {
            other.send(&numbered(0x181, sent)).unwrap();
            sent += 1;
        }
        came.extend(drain(&mut host).iter().map(number));
    }
    // The kernel says it with the next frame that it does not drop.
    other.send(&numbered(0x181, sent)).unwrap();
    came.extend(drain(&mut host).iter().map(number));
    let lost = u64::from(sent) + 1 - came.len() as u64;
    assert_eq!(host.dropped(), lost);
    assert!(lost > 1_000, "{lost} of {sent} dropped: no flood");
    assert!(came.len() > 3 * 500, "{} frames in three full buffers: the buffer was not raised", came.len());
    assert!(came.is_sorted(), "in order");
    say(&format!("flood of {} frames: {} received, {lost} dropped and counted", sent + 1, came.len()));
}

#[test]
fn a_reader_that_keeps_up_loses_nothing() {
    let Some(interface) = Interface::new() else { return };
    const FRAMES: u32 = 20_000;
    let (mut host, mut other) = (interface.bus(&[0x181, 0x080]), interface.bus(&[0x080]));
    let began = monotonic_now();
    let sender = thread::spawn(move || {
        for count in 0..FRAMES {
            other.send(&Frame::fd(Id::from_low_bits(0x181), count.to_le_bytes())).unwrap();
            // Paced by the reader, a few batches at a time.
            if count % 256 == 255 {
                other.receive(monotonic_now() + Span::s(5.0)).unwrap();
            }
        }
    });
    for expected in 0..FRAMES {
        let received = host.receive(monotonic_now() + Span::s(5.0)).unwrap();
        assert_eq!(number(&received), expected);
        if expected % 256 == 255 {
            host.send(&numbered(0x080, expected)).unwrap();
        }
    }
    let seconds = (monotonic_now() - began).as_s();
    sender.join().unwrap();
    assert_eq!(host.dropped(), 0);
    say(&format!("{:.0} frames per second from thread to thread", f64::from(FRAMES) / seconds));
}

#[test]
fn a_full_queue_of_the_interface_refuses_and_keeps_what_it_has() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut board) = (interface.bus(&[]), interface.bus(&[0x201, 0x202]));
    // A queue with room for four frames, each of which takes its time.
    network("tc", &format!("qdisc replace dev {} root netem delay 300ms limit 4", interface.name));
    let frames: Vec<Frame> = (0..6).map(|count| numbered(0x201, count)).collect();
    assert_eq!(host.send_all(&frames), Err(SendError::Full));
    assert_eq!(host.send(&numbered(0x202, 9)), Err(SendError::Full));
    let began = monotonic_now();
    while host.send(&numbered(0x202, 10)).is_err() {
        assert!(monotonic_now() - began < Span::s(5.0), "the queue does not empty");
    }
    let came: Vec<u32> = drain(&mut board).iter().map(number).collect();
    assert_eq!(came, [0, 1, 2, 3, 10]);
}

#[test]
fn a_long_run_touches_no_heap_whatever_happens_to_the_bus() {
    let Some(interface) = Interface::new() else { return };
    let (mut host, mut board) = (interface.bus(&[0x181, 0x182]), interface.bus(&[0x080, 0x201, 0x202]));
    let feedback = [0x181, 0x182].map(|id| Frame::fd(Id::from_low_bits(id), [1; 24]));
    let commands = [0x201, 0x202].map(|id| Frame::fd(Id::from_low_bits(id), [2; 12]));
    let cycle = |host: &mut dyn Bus, board: &mut dyn Bus, count: u32| {
        let _refused = host.send(&numbered(0x080, count));
        while board.receive(Moment::ZERO).is_some() {}
        let _refused = board.send_all(&feedback);
        let until = monotonic_now() + Span::us(200);
        let mut heard = 0;
        while heard < 2 && host.receive(until).is_some() {
            heard += 1;
        }
        let _refused = host.send_all(&commands);
        heard
    };
    let mut guarded = |cycles: u32| {
        let before = touched();
        let heard: u32 = (0..cycles).map(|count| cycle(&mut host, &mut board, count)).sum();
        (heard, touched() - before)
    };
    assert_eq!(guarded(2_000), (4_000, 0), "frames heard, and allocations, in a quiet run");
    interface.down();
    assert_eq!(guarded(20), (0, 0), "while the interface is down");
    interface.up();
    let (heard, allocations) = guarded(200);
    assert!(heard > 300 && allocations == 0, "{heard} frames, {allocations} allocations after it was down");
    interface.remove();
    assert_eq!(guarded(20), (0, 0), "while the interface is away");
    interface.make(72);
    let (heard, allocations) = guarded(1_000);
    assert!(
        heard > 200 && allocations == 0,
        "{heard} frames, {allocations} allocations after it was removed"
    );
    let before = touched();
    for count in 0..20_000 {
        let _full = board.send(&numbered(0x181, count));
    }
    while host.receive(Moment::ZERO).is_some() {}
    let _full = board.send(&numbered(0x181, 0));
    while host.receive(Moment::ZERO).is_some() {}
    assert_eq!(touched() - before, 0, "in a flood");
    assert!(host.dropped() > 1_000, "{} dropped", host.dropped());
}
