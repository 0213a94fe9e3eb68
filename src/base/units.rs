//! Quantities with their units: SI inside, other units only at the doors.
//!
//! A quantity is a newtype over `f64`. Adding two of a kind, negating, scaling by a number and
//! dividing two of a kind (a ratio) compile; mixing kinds does not. Arithmetic across kinds runs
//! on suffixed locals (`speed_m_per_s`) inside one short kernel.
//!
//! Positions and velocities are *travel of the axis* in metres, at the motor as at the table: a
//! motor angle is already multiplied by lead / 2π when it becomes a [`Position`].
//! Invariant: a constructor and an accessor name the unit; there is no bare `new`.

use std::fmt;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $si:literal, $make:ident, $read:ident $(, $unit:ident / $read_unit:ident = $per:literal)*) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
        pub struct $name(f64);

        impl $name {
            /// Nothing of it.
            pub const ZERO: Self = Self(0.0);
            #[doc = concat!("From a number of ", $si, ".")]
            pub const fn $make(value: f64) -> Self { Self(value) }
            #[doc = concat!("As a number of ", $si, ".")]
            pub const fn $read(self) -> f64 { self.0 }
            // Units per SI unit are whole numbers, so a round trip is as good as it can be.
            $(
                #[doc = concat!("From a number of `", stringify!($unit), "`.")]
                pub const fn $unit(value: f64) -> Self { Self(value / $per) }
                #[doc = concat!("As a number of `", stringify!($unit), "`.")]
                pub const fn $read_unit(self) -> f64 { self.0 * $per }
            )*
            /// Magnitude.
            pub const fn abs(self) -> Self { Self(self.0.abs()) }
            /// Neither infinite nor NaN.
            pub const fn is_finite(self) -> bool { self.0.is_finite() }
            /// The value held within `±bound`. A NaN stays NaN, so that it can be caught.
            pub const fn clamp_abs(self, bound: Self) -> Self {
                if self.0 > bound.0 { bound } else if self.0 < -bound.0 { Self(-bound.0) } else { self }
            }
        }
        impl Add for $name { type Output = Self; fn add(self, other: Self) -> Self { Self(self.0 + other.0) } }
        impl Sub for $name { type Output = Self; fn sub(self, other: Self) -> Self { Self(self.0 - other.0) } }
        impl AddAssign for $name { fn add_assign(&mut self, other: Self) { self.0 += other.0; } }
        impl SubAssign for $name { fn sub_assign(&mut self, other: Self) { self.0 -= other.0; } }
        impl Neg for $name { type Output = Self; fn neg(self) -> Self { Self(-self.0) } }
        impl Mul<f64> for $name { type Output = Self; fn mul(self, scale: f64) -> Self { Self(self.0 * scale) } }
        impl Div<f64> for $name { type Output = Self; fn div(self, scale: f64) -> Self { Self(self.0 / scale) } }
        impl Div for $name { type Output = f64; fn div(self, other: Self) -> f64 { self.0 / other.0 } }
        impl fmt::Display for $name {
            fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
                fmt::Display::fmt(&self.0, out)?;
                out.write_str(concat!(" ", $si))
            }
        }
    };
}

quantity!(
    /// Where along its travel an axis is, or a distance along it.
    Position, "m", m, as_m, mm / as_mm = 1e3, um / as_um = 1e6
);
quantity!(
    /// Speed along the travel of an axis, signed.
    Velocity, "m/s", m_per_s, as_m_per_s, mm_per_s / as_mm_per_s = 1e3, mm_per_min / as_mm_per_min = 60e3
);
quantity!(
    /// Rate of change of velocity along the travel.
    Acceleration, "m/s^2", m_per_s2, as_m_per_s2
);
quantity!(
    /// Force along the travel, at the table.
    Force, "N", n, as_n
);
quantity!(
    /// Torque at the motor shaft.
    Torque, "N m", nm, as_nm
);
quantity!(
    /// Motor current, signed like the torque it makes.
    Current, "A", a, as_a
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_convert_at_the_door() {
        assert!((Velocity::mm_per_min(2000.0).as_mm_per_s() - 33.333_333_333).abs() < 1e-9);
        assert!((Position::um(25.0).as_mm() - 0.025).abs() < 1e-15);
    }

    #[test]
    fn a_clamp_lets_a_nan_be_seen() {
        assert!(!Torque::nm(f64::NAN).clamp_abs(Torque::nm(1.0)).is_finite());
        assert_eq!(Torque::nm(-3.0).clamp_abs(Torque::nm(1.0)), Torque::nm(-1.0));
    }
}
