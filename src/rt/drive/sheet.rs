//! What must be true inside a board: its sheet, and the hash that vouches for it.
//!
//! A sheet comes from a file in `firmware-config/`; the drives are commissioned against it and
//! simulated boards are built from it.
//!
//! The hash is the CRC-32 (ISO-HDLC, as in zlib) over the canonical listing of the sheet: for every
//! object of [`SHEET`], in order of the addresses, the seven bytes of a parameter reply that carry
//! address and value (index u16, sub-index u8, value u32, little endian). A board computes it at
//! boot from the values it runs with, so one read tells whether all of them are those of the sheet;
//! only when it differs is each value read and the odd one named. The serial number is no part of
//! it: two boards of one type have one sheet.
//! Invariant: a [`Sheet`] holds only values in range, and gives back exactly those it was read from.

use crate::base::time::Span;
use crate::rt::wire::parameter::Object;
use crate::rt::wire::scaling::CurrentCounts;

/// The objects a sheet states, in order of the addresses.
pub const SHEET: [Object; 10] = [
    Object::HeartbeatPeriod,
    Object::Vendor,
    Object::Product,
    Object::Revision,
    Object::Watchdog,
    Object::CommandApplies,
    Object::MotorCountsPerRev,
    Object::TableCountsPerMm,
    Object::PeakCurrent,
    Object::RatedCurrent,
];

/// When a command acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandApplies {
    /// As soon as the board has it.
    OnReceipt,
    /// At the SYNC after it: every board at the same instant, one period later.
    OnNextSync,
}

/// The values of a board of one type, as numbers of the unit that stands in [`Object::unit`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sheet {
    /// Who made the board.
    pub vendor: u32,
    /// What it is.
    pub product: u32,
    /// Which firmware it runs.
    pub revision: u32,
    /// How often the board says that it is alive.
    pub heartbeat_period_ms: u32,
    /// The longest time without a fresh command before the board takes the current away.
    pub watchdog_us: u32,
    /// When a command acts.
    pub command_applies: CommandApplies,
    /// Motor encoder counts per revolution.
    pub motor_counts_per_rev: u32,
    /// Table scale counts per millimetre; 0 without a table scale.
    pub table_counts_per_mm: u32,
    /// The most current the drive gives.
    pub peak_current_ma: u32,
    /// The current the motor bears for ever.
    pub rated_current_ma: u32,
}

/// A value no board can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SheetError {
    /// Outside the range of its object.
    #[error("{object} is {value} {unit}, allowed are {low} to {high}", unit = .object.unit(),
            low = .object.range().start(), high = .object.range().end())]
    OutOfRange {
        /// Which value.
        object: Object,
        /// What it is, in the unit of the object.
        value: u32,
    },
    /// The drive could not even give what its motor bears for ever.
    #[error("{peak} is {peak_ma} mA, below {rated} of {rated_ma} mA", peak = Object::PeakCurrent,
            rated = Object::RatedCurrent)]
    PeakBelowRated {
        /// Peak current in mA.
        peak_ma: u32,
        /// Rated current in mA.
        rated_ma: u32,
    },
}

impl Sheet {
    /// A sheet from the value of each object of [`SHEET`].
    pub fn from_values(value_of: impl Fn(Object) -> u32) -> Result<Self, SheetError> {
        for object in SHEET {
            let value = value_of(object);
            if !object.range().contains(&value) {
                return Err(SheetError::OutOfRange { object, value });
            }
        }
        let (peak_ma, rated_ma) = (value_of(Object::PeakCurrent), value_of(Object::RatedCurrent));
        if peak_ma < rated_ma {
            return Err(SheetError::PeakBelowRated { peak_ma, rated_ma });
        }
        Ok(Self {
            vendor: value_of(Object::Vendor),
            product: value_of(Object::Product),
            revision: value_of(Object::Revision),
            heartbeat_period_ms: value_of(Object::HeartbeatPeriod),
            watchdog_us: value_of(Object::Watchdog),
            command_applies: match value_of(Object::CommandApplies) {
                0 => CommandApplies::OnReceipt,
                _ => CommandApplies::OnNextSync,
            },
            motor_counts_per_rev: value_of(Object::MotorCountsPerRev),
            table_counts_per_mm: value_of(Object::TableCountsPerMm),
            peak_current_ma: peak_ma,
            rated_current_ma: rated_ma,
        })
    }

    /// The value of an object as the board would send it; `None` for what no sheet states.
    pub const fn value(&self, object: Object) -> Option<u32> {
        match object {
            Object::Vendor => Some(self.vendor),
            Object::Product => Some(self.product),
            Object::Revision => Some(self.revision),
            Object::HeartbeatPeriod => Some(self.heartbeat_period_ms),
            Object::Watchdog => Some(self.watchdog_us),
            Object::CommandApplies => Some(match self.command_applies {
                CommandApplies::OnReceipt => 0,
                CommandApplies::OnNextSync => 1,
            }),
            Object::MotorCountsPerRev => Some(self.motor_counts_per_rev),
            Object::TableCountsPerMm => Some(self.table_counts_per_mm),
            Object::PeakCurrent => Some(self.peak_current_ma),
            Object::RatedCurrent => Some(self.rated_current_ma),
            Object::Serial | Object::FirmwareConfigHash => None,
        }
    }

    /// CRC-32 over the canonical listing.
    pub fn firmware_config_hash(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        for object in SHEET {
            let (address, value) = (object.address(), self.value(object).unwrap_or(0));
            hasher.update(&address.index.to_le_bytes());
            hasher.update(&[address.sub]);
            hasher.update(&value.to_le_bytes());
        }
        hasher.finalize()
    }

    /// How often the board says that it is alive.
    pub const fn heartbeat_period(&self) -> Span {
        Span::ms(self.heartbeat_period_ms as i64)
    }
    /// The longest time without a fresh command before the board takes the current away.
    pub const fn watchdog(&self) -> Span {
        Span::us(self.watchdog_us as i64)
    }
    /// From the SYNC whose feedback a command answers to the moment it acts.
    pub const fn command_delay(&self, period: Span) -> Span {
        match self.command_applies {
            CommandApplies::OnReceipt => Span::ZERO,
            CommandApplies::OnNextSync => period,
        }
    }
    /// The most current the drive gives, as it travels.
    pub const fn peak_current(&self) -> CurrentCounts {
        CurrentCounts::ma(self.peak_current_ma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value_of(object: Object) -> u32 {
        match object {
            Object::Watchdog => 5_000,
            Object::CommandApplies => 1,
            Object::PeakCurrent => 20_000,
            other => u32::from(other.address().sub) + 2,
        }
    }

    #[test]
    fn a_sheet_gives_back_the_values_it_was_read_from() {
        let sheet = Sheet::from_values(value_of).expect("values are in range");
        for object in SHEET {
            assert_eq!(sheet.value(object), Some(value_of(object)), "{object}");
        }
    }

    #[test]
    fn a_value_out_of_range_is_named_with_its_bounds() {
        let broken = |object| if object == Object::Watchdog { 7 } else { value_of(object) };
        let error = Sheet::from_values(broken).expect_err("7 us is too short");
        assert_eq!(error.to_string(), "watchdog (object 2001:0) is 7 us, allowed are 100 to 1000000");
        let weak = |object| if object == Object::RatedCurrent { 30_000 } else { value_of(object) };
        assert_eq!(
            Sheet::from_values(weak),
            Err(SheetError::PeakBelowRated { peak_ma: 20_000, rated_ma: 30_000 })
        );
    }

    #[test]
    fn the_hash_sees_every_value_of_the_sheet() {
        let hash = |value_of: &dyn Fn(Object) -> u32| {
            Sheet::from_values(value_of).expect("values are in range").firmware_config_hash()
        };
        let known = hash(&value_of);
        for changed in SHEET {
            let other = |object| if object == changed { value_of(object) ^ 1 } else { value_of(object) };
            assert_ne!(hash(&other), known, "{changed} is no part of the hash");
        }
    }

    #[test]
    fn the_hash_is_that_of_the_bytes_of_the_parameter_replies() {
        use crate::rt::wire::{Node, parameter};
        let sheet = Sheet::from_values(value_of).expect("values are in range");
        let listing: Vec<u8> = SHEET
            .into_iter()
            .flat_map(|object| {
                let reply = parameter::encode_reply(Node::MAX, object.address(), Ok(value_of(object)));
                reply.payload()[1..].to_vec()
            })
            .collect();
        assert_eq!(sheet.firmware_config_hash(), crc32fast::hash(&listing));
        assert!(SHEET.map(Object::address).is_sorted(), "the listing is in order of the addresses");
    }
}
