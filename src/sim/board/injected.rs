//! Faults on purpose: what a board does wrong when it is told to.
//!
//! Invariant: the board behaves as a real one would, so nothing here can be seen but on the bus.

use super::Board;
use crate::base::time::Moment;
use crate::rt::drive::sheet::Sheet;
use crate::rt::wire::parameter::Object;
use crate::rt::wire::scaling::{CurrentCounts, EncoderCounts, TravelCounts};
use crate::rt::wire::state::Emergency;

impl Board {
    /// Sends nothing from now on, or sends again. It still hears.
    pub const fn set_silent(&mut self, is_silent: bool) {
        self.injected.is_silent = is_silent;
    }
    /// Repeats the last encoder readings as if they were new, or reads again. The board does not
    /// notice.
    pub const fn set_encoder_frozen(&mut self, is_frozen: bool) {
        self.injected.is_encoder_frozen = is_frozen;
    }
    /// Loses trust in its encoder and says so, or gets it back.
    pub fn set_encoder_error(&mut self, has_error: bool) {
        if has_error && !self.injected.has_encoder_error {
            self.report(Emergency::CODE_ENCODER, 0);
        }
        self.injected.has_encoder_error = has_error;
    }
    /// Moves the motor encoder's readings by `step`, once.
    pub const fn jump_encoder(&mut self, step: TravelCounts) {
        self.motor_start = self.motor_start.after(step);
    }
    /// Restarts the board, as a dip of its supply does. Its encoders keep their counts.
    pub fn reset(&mut self, now: Moment) {
        self.reset_count = self.reset_count.wrapping_add(1);
        self.outbox.clear();
        self.injected.has_drive_fault = false;
        self.boot(now);
    }
    /// Takes the power away and gives it back: encoders and resets are counted from zero again.
    pub fn power_cycle(&mut self, now: Moment) {
        let way_back = |way: TravelCounts| TravelCounts::counts(-way.as_counts());
        self.motor_start = EncoderCounts::counts(0).after(way_back(self.last_measured.motor));
        self.table_start = EncoderCounts::counts(0).after(way_back(self.last_measured.table));
        self.reset_count = 0;
        self.outbox.clear();
        self.injected.has_drive_fault = false;
        self.boot(now);
    }
    /// The drive finds a fault of its own, with the error code of its emergency and a detail.
    pub fn trip_drive(&mut self, code: u16, detail: u16) {
        self.injected.has_drive_fault = true;
        self.report(code, detail);
        self.step_drive(self.command.control_word);
    }
    /// Answers with `value` when asked for `object`: a wrong board, or wrong firmware settings.
    pub const fn pretend(&mut self, object: Object, value: u32) {
        self.injected.false_value = Some((object, value));
    }
    /// Runs with another sheet than its type should: a wrong board, or wrong firmware settings.
    pub const fn reprogram(&mut self, sheet: Sheet) {
        self.sheet = sheet;
    }
    /// What the board runs with.
    pub const fn sheet(&self) -> &Sheet {
        &self.sheet
    }
    /// The encoders' counters stand so far before their wrap.
    pub const fn place_before_wrap(&mut self, motor: TravelCounts, table: TravelCounts) {
        self.motor_start = EncoderCounts::counts(0).after(TravelCounts::counts(-motor.as_counts()));
        self.table_start = EncoderCounts::counts(0).after(TravelCounts::counts(-table.as_counts()));
    }
    /// The drive gives no more than this, or its peak again.
    pub const fn limit_current(&mut self, current_max: Option<CurrentCounts>) {
        self.injected.current_max = current_max;
    }
    /// The board's CAN controller leaves the bus, so that it neither hears nor sends; or takes part again,
    /// which the board reports as an error that was.
    pub fn set_off_bus(&mut self, is_off_bus: bool) {
        let is_back = self.injected.is_off_bus && !is_off_bus;
        self.injected.is_off_bus = is_off_bus;
        if is_off_bus {
            self.outbox.clear();
        } else if is_back {
            self.report(Emergency::CODE_BUS_OFF_RECOVERED, 0);
        }
    }
}
