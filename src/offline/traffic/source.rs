//! The frames of one interface in a text, in order, with an account of all that was left out.
//!
//! Invariant: no time goes back; a line that is not handed out is counted.

use std::collections::VecDeque;
use std::io::Read;

use serde::Serialize;

use super::import::ImportError;
use crate::base::frame::Frame;
use crate::candump::Lines;

/// What is read of a text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Wanted {
    /// The interface; `None`: the only one.
    pub interface: Option<String>,
    /// Leave out lines that cannot be read, instead of ending there.
    pub skips_damaged: bool,
}

/// What was left out of a text.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// Lines that cannot be read.
    pub damaged_lines: u64,
    /// What is wrong with the first of them.
    pub first_damage: Option<String>,
    /// Frames of other interfaces.
    pub of_other_interfaces: u64,
    /// Frames that are none of ours: 29-bit identifiers, remote frames, CAN XL.
    pub of_other_kinds: u64,
    /// Frames that the listener lost, by its own account.
    pub dropped: u64,
    /// Lines whose time was before that of the line above; they stand at that time.
    pub times_back: u64,
}

/// A frame and when it was seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) line: u64,
    /// Nanoseconds since 1970.
    pub(super) wall_ns: i64,
    pub(super) frame: Frame,
}

/// The frames of one interface.
#[derive(Debug)]
pub(super) struct Source<R> {
    lines: Lines<R>,
    interface: Option<String>,
    is_one_of_many: bool,
    skips_damaged: bool,
    left_out: LeftOut,
    wall_ns: i64,
    ahead: VecDeque<Seen>,
}

impl<R: Read> Source<R> {
    pub(super) fn new(text: R, wanted: &Wanted) -> Self {
        Self {
            lines: Lines::new(text),
            interface: wanted.interface.clone(),
            is_one_of_many: wanted.interface.is_some(),
            skips_damaged: wanted.skips_damaged,
            left_out: LeftOut::default(),
            wall_ns: i64::MIN,
            ahead: VecDeque::new(),
        }
    }

    /// The interface; empty before its first frame.
    pub(super) fn interface(&self) -> &str {
        self.interface.as_deref().unwrap_or_default()
    }

    pub(super) fn left_out(&self) -> LeftOut {
        let of_other_kinds = self.lines.passed_over();
        LeftOut { of_other_kinds, dropped: self.dropped(), ..self.left_out.clone() }
    }

    /// Frames that the listener lost so far, by its own account.
    pub(super) const fn dropped(&self) -> u64 {
        self.lines.dropped()
    }

    /// The next frame; `None` at the end of the text.
    pub(super) fn next(&mut self) -> Result<Option<Seen>, ImportError> {
        let ahead = self.ahead.pop_front();
        if ahead.is_some() { Ok(ahead) } else { self.read() }
    }

    /// The next frame of a kind; all up to it are still to come.
    pub(super) fn peek(&mut self, is_it: impl Fn(&Frame) -> bool) -> Result<Option<Seen>, ImportError> {
        if let Some(seen) = self.ahead.iter().find(|seen| is_it(&seen.frame)) {
            return Ok(Some(*seen));
        }
        while let Some(seen) = self.read()? {
            self.ahead.push_back(seen);
            if is_it(&seen.frame) {
                return Ok(Some(seen));
            }
        }
        Ok(None)
    }

    /// Whether a frame of a kind has been read ahead.
    pub(super) fn has_ahead(&self, is_it: impl Fn(&Frame) -> bool) -> bool {
        self.ahead.iter().any(|seen| is_it(&seen.frame))
    }

    fn read(&mut self) -> Result<Option<Seen>, ImportError> {
        loop {
            let line = match self.lines.next_frame() {
                Ok(Some(line)) => line,
                Ok(None) => return Ok(None),
                Err(error) if self.skips_damaged && error.is_of_line() => {
                    self.left_out.damaged_lines += 1;
                    self.left_out.first_damage.get_or_insert_with(|| error.to_string());
                    continue;
                }
                Err(error) => return Err(error.into()),
            };
            let interface = self.interface.get_or_insert_with(|| line.interface.clone());
            if *interface == line.interface {
                self.left_out.times_back += u64::from(line.wall_ns < self.wall_ns);
                self.wall_ns = self.wall_ns.max(line.wall_ns);
                return Ok(Some(Seen { line: line.number, wall_ns: self.wall_ns, frame: line.frame }));
            }
            if !self.is_one_of_many {
                let (first, second) = (interface.clone(), line.interface);
                return Err(ImportError::TwoInterfaces { line: line.number, first, second });
            }
            self.left_out.of_other_interfaces += 1;
        }
    }
}
