//! How much of the bus a cycle takes: bits on the wire of its SYNC, feedback and command frames, with
//! the most stuff bits that their fields can need (ISO 11898-1).
//!
//! Invariant: an upper bound; error frames and retransmission are not in it.

use super::machine::Machine;
use crate::rt::bus::{Format, Frame};
use crate::rt::wire::CycleFrames;

/// Load of one cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BusLoad {
    /// Time that SYNC and feedback of all axes take, s.
    pub replies_s: f64,
    /// Time that the commands of all axes take, s.
    pub commands_s: f64,
    /// Both, as a share of the period.
    pub share: f64,
    /// Frames per cycle.
    pub frames: usize,
}

/// Bits of one frame: at the nominal and at the data bit rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Bits {
    nominal: usize,
    data: usize,
}

fn bits(format: Format, payload_bytes: usize) -> Bits {
    let payload = 8 * payload_bytes;
    match format {
        // It never was on the wire.
        Format::Report => Bits { nominal: 0, data: 0 },
        // SOF 1, identifier 11, RTR, IDE, r0, DLC 4, payload, CRC 15 are stuffed; then CRC delimiter,
        // ACK, ACK delimiter, EOF 7, intermission 3.
        Format::Classic => {
            let stuffed = 1 + 11 + 3 + 4 + payload + 15;
            Bits { nominal: stuffed + (stuffed - 1) / 4 + 13, data: 0 }
        }
        // SOF 1, identifier 11, RRS, IDE, FDF, res, BRS | ESI, DLC 4, payload | stuff count 4 and CRC with
        // a fixed stuff bit ahead of every four bits | CRC delimiter, ACK, delimiter, EOF 7, intermission 3.
        Format::Fd { bit_rate_switch } => {
            let arbitration = 1 + 11 + 5;
            let stuffed = 1 + 4 + payload;
            let crc = 4 + if payload_bytes <= 16 { 17 } else { 21 };
            let nominal = arbitration + arbitration / 4 + 13;
            let data = stuffed + stuffed / 4 + 1 + crc + crc.div_ceil(4);
            if bit_rate_switch { Bits { nominal, data } } else { Bits { nominal: nominal + data, data: 0 } }
        }
    }
}

impl BusLoad {
    /// Load of a machine's cycle.
    pub fn of(machine: &Machine) -> Self {
        let time_s = |frame: &Frame| {
            let bits = bits(frame.format(), frame.length());
            bits.nominal as f64 / f64::from(machine.bus.nominal_bit_per_s)
                + bits.data as f64 / f64::from(machine.bus.data_bit_per_s)
        };
        let axes = machine.axes.count();
        let CycleFrames { sync, feedback, command } = CycleFrames::of(machine.bus.layout);
        let feedback_s: f64 = feedback.iter().flatten().map(&time_s).sum();
        let replies_s = time_s(&sync) + feedback_s * axes as f64;
        let commands_s = time_s(&command) * axes as f64;
        let share = (replies_s + commands_s) / machine.cycle.period.as_s();
        Self { replies_s, commands_s, share, frames: 1 + (1 + feedback.iter().flatten().count()) * axes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_classic_frame_of_eight_bytes_has_at_most_135_bits() {
        // The figure of the response-time literature (Davis 2007): 55 + 10 n for 11-bit identifiers.
        for bytes in 0..=8 {
            assert_eq!(bits(Format::Classic, bytes), Bits { nominal: 55 + 10 * bytes, data: 0 });
        }
    }

    #[test]
    fn an_fd_frame_switches_its_payload_to_the_fast_rate() {
        let slow = bits(Format::Fd { bit_rate_switch: false }, 24);
        let fast = bits(Format::Fd { bit_rate_switch: true }, 24);
        assert_eq!(slow.nominal, fast.nominal + fast.data);
        assert!(fast.nominal < 40 && fast.data > 24 * 8, "{fast:?}");
    }
}
