//! Interfaces of their own for the tests, so that one may take its own down; and buses on them.

use std::io::Write;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use quadrant::base::time::{Moment, Span};
use quadrant::rt::bus::socketcan::{Settings, SocketCan};
use quadrant::rt::bus::{Bus, Frame, Id, Received};
use quadrant::rt::clock::monotonic_now;
use socketcan::{CanSocket, Socket};

/// Said where one of their tools is missing.
pub(crate) const CAN_UTILS: &str = "candump, cansend and cangen are in the package can-utils";

/// Says something past the capture of the test harness.
pub(crate) fn say(text: &str) {
    let _unheard = writeln!(std::io::stderr(), "{text}");
}

/// Runs `ip` or `tc` with these words.
#[track_caller]
pub(crate) fn network(program: &str, words: &str) {
    let path = format!("{}:/usr/sbin:/sbin", std::env::var("PATH").unwrap_or_default());
    let output = Command::new(program).args(words.split(' ')).env("PATH", path).output().unwrap();
    assert!(output.status.success(), "{program} {words}: {}", String::from_utf8_lossy(&output.stderr));
}

/// A virtual interface; gone with its value.
pub(crate) struct Interface {
    pub(crate) name: String,
}

impl Interface {
    /// `None`, said aloud, where there is no virtual CAN.
    #[track_caller]
    pub(crate) fn new() -> Option<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(1);
        if std::env::var_os("QUADRANT_VCAN").is_none() {
            let test = std::thread::current().name().unwrap_or("a test").to_owned();
            say(&format!("SKIPPED, no virtual CAN here: {test}; run it by tests/vcan/with-vcan"));
            return None;
        }
        let own = Self { name: format!("vcan{}", COUNT.fetch_add(1, Ordering::Relaxed)) };
        own.make(72);
        Some(own)
    }

    #[track_caller]
    pub(crate) fn make(&self, mtu: u32) {
        network("ip", &format!("link add dev {} mtu {mtu} type vcan", self.name));
        self.up();
    }
    #[track_caller]
    pub(crate) fn up(&self) {
        network("ip", &format!("link set {} up", self.name));
    }
    #[track_caller]
    pub(crate) fn down(&self) {
        network("ip", &format!("link set {} down", self.name));
    }
    #[track_caller]
    pub(crate) fn remove(&self) {
        network("ip", &format!("link del {}", self.name));
    }

    /// A bus for these identifiers, on the monotonic clock.
    #[track_caller]
    pub(crate) fn bus(&self, identifiers: &[u16]) -> SocketCan {
        let identifiers = ids(identifiers);
        let settings = Settings { interface: &self.name, identifiers: &identifiers, is_fd: true };
        SocketCan::open(&settings, Moment::ZERO).unwrap()
    }

    /// A socket without a bus around it, for what a bus does not send.
    #[track_caller]
    pub(crate) fn socket(&self) -> CanSocket {
        CanSocket::open(&self.name).unwrap()
    }
}

impl Drop for Interface {
    fn drop(&mut self) {
        let _removed_by_its_test = Command::new("ip").args(["link", "del", &self.name]).output();
    }
}

pub(crate) fn ids(raw: &[u16]) -> Vec<Id> {
    raw.iter().copied().map(Id::from_low_bits).collect()
}

/// A classic frame with a number.
pub(crate) fn numbered(id: u16, number: u32) -> Frame {
    Frame::classic(Id::from_low_bits(id), number.to_le_bytes())
}

pub(crate) fn number(received: &Received) -> u32 {
    u32::from_le_bytes(*received.frame.payload_of().unwrap())
}

/// Everything that comes until nothing has come for a while.
pub(crate) fn drain(bus: &mut SocketCan) -> Vec<Received> {
    std::iter::from_fn(|| bus.receive(monotonic_now() + Span::ms(20))).collect()
}

/// A classic frame as the kernel has it, whatever its identifier and flags.
pub(crate) fn classic_bytes(identifier: u32, payload: [u8; 8]) -> [u8; 16] {
    let mut bytes = [0; 16];
    bytes[..4].copy_from_slice(&identifier.to_ne_bytes());
    bytes[4] = 8;
    bytes[8..].copy_from_slice(&payload);
    bytes
}
