//! Frames as text, as `candump -L` of can-utils writes them and its `canplayer` reads them:
//!
//! ```text
//!   (1735270496.916858) can0 080#2A000000              classic
//!   (1735270496.917021) can0 181##5F3A1...             FD; the digit is a set: 1 bit rate switch, 4 FD
//!   (1735270496.917400) can0 20000004#0010000000000000 report of the own controller: 2000_0000h + classes
//! ```
//!
//! Read is all that candump can write: times in ns (`-N`), names of interfaces made equally long, directions
//! (`-x`), counts of dropped frames (`-d`). Frames that are none of ours (29-bit identifiers, remote frames,
//! CAN XL) are counted and passed over. Anything else is refused with its line.
//! Invariant: what [`write()`] writes is read as it was, but for the time, which is cut to microseconds.

use std::io::{self, BufRead, BufReader, Read, Write};

use crate::base::frame::{Format, Frame, Id};

/// Most bytes of a line: a CAN XL frame takes twice its 2048, and there is a name before it.
const LINE_BYTES_MAX: u64 = 5_000;
/// Most characters of a text that is quoted.
const QUOTE_MAX: usize = 40;
/// An identifier of 8 digits with this bit is a report of a controller (`linux/can.h`: `CAN_ERR_FLAG`).
const REPORT: u32 = 0x2000_0000;
const BIT_RATE_SWITCH: u8 = 1;
const FD: u8 = 4;

/// A frame, where and when it was seen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Line {
    /// Which line of the text.
    pub number: u64,
    /// Nanoseconds since 1970.
    pub wall_ns: i64,
    /// Name of the interface.
    pub interface: String,
    /// What was seen.
    pub frame: Frame,
}

/// What is no text of candump.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    /// The line does not begin with a time.
    #[error("line {line}: `{found}` is no time, expected seconds with 6 or 9 decimals: (1735270496.916858)")]
    Time {
        /// Which line.
        line: u64,
        /// What stands there.
        found: String,
    },
    /// The line ends behind its time, or behind its interface.
    #[error("line {line}: it ends too early, expected a time, an interface and a frame")]
    Short {
        /// Which line.
        line: u64,
    },
    /// No frame stands behind the interface.
    #[error("line {line}: `{found}` is no frame, expected an identifier, # or ##, and bytes: 181#0011AA")]
    Frame {
        /// Which line.
        line: u64,
        /// What stands there.
        found: String,
    },
    /// Something stands behind the frame.
    #[error("line {line}: `{found}` stands behind the frame, expected nothing, R or T")]
    Tail {
        /// Which line.
        line: u64,
        /// What stands there.
        found: String,
    },
    /// The text cannot be read.
    #[error("line {line}: {cause}")]
    Unreadable {
        /// Which line.
        line: u64,
        /// What the system says.
        cause: io::Error,
    },
}

/// Reads a text line by line.
#[derive(Debug)]
pub struct Lines<R> {
    text: BufReader<R>,
    line: Vec<u8>,
    number: u64,
    passed_over: u64,
    dropped: u64,
}

impl<R: Read> Lines<R> {
    /// Lines of a text.
    pub fn new(text: R) -> Self {
        Self { text: BufReader::new(text), line: Vec::new(), number: 0, passed_over: 0, dropped: 0 }
    }

    /// The next frame; `None` at the end of the text.
    pub fn next_frame(&mut self) -> Result<Option<Line>, TextError> {
        loop {
            self.number += 1;
            self.line.clear();
            let mut limited = self.text.by_ref().take(LINE_BYTES_MAX);
            let read = limited.read_until(b'\n', &mut self.line);
            let line = self.number;
            if read.map_err(|cause| TextError::Unreadable { line, cause })? == 0 {
                return Ok(None);
            }
            let text = String::from_utf8_lossy(&self.line);
            match parse(self.number, &text)? {
                Parsed::Line(line) => return Ok(Some(line)),
                Parsed::PassedOver => self.passed_over += 1,
                Parsed::Dropped(frames) => self.dropped += frames,
            }
        }
    }

    /// Frames so far that were none of ours.
    pub const fn passed_over(&self) -> u64 {
        self.passed_over
    }

    /// Frames that candump says it lost so far.
    pub const fn dropped(&self) -> u64 {
        self.dropped
    }
}

/// What a line says.
enum Parsed {
    Line(Line),
    PassedOver,
    Dropped(u64),
}

fn parse(line: u64, text: &str) -> Result<Parsed, TextError> {
    if let Some(frames) = dropped(text) {
        return Ok(Parsed::Dropped(frames));
    }
    let mut words = text.split_ascii_whitespace();
    let time = words.next().unwrap_or_default();
    let wall_ns = wall_ns(time).ok_or_else(|| TextError::Time { line, found: quoted(time) })?;
    let (Some(interface), Some(frame_text)) = (words.next(), words.next()) else {
        return Err(TextError::Short { line });
    };
    if let Some(tail) = words.find(|word| !matches!(*word, "R" | "T")) {
        return Err(TextError::Tail { line, found: quoted(tail) });
    }
    match frame(frame_text) {
        Some(Seen::Ours(frame)) => {
            Ok(Parsed::Line(Line { number: line, wall_ns, interface: interface.to_owned(), frame }))
        }
        Some(Seen::Foreign) => Ok(Parsed::PassedOver),
        None => Err(TextError::Frame { line, found: quoted(frame_text) }),
    }
}

fn quoted(text: &str) -> String {
    let mut quoted: String = text.chars().take(QUOTE_MAX).collect();
    if quoted.len() < text.len() {
        quoted.push('…');
    }
    quoted
}

/// `DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 7)`: how many.
fn dropped(text: &str) -> Option<u64> {
    let rest = text.strip_prefix("DROPCOUNT: dropped ")?;
    rest.split_once(' ')?.0.parse().ok()
}

/// `(seconds.fraction)`, the fraction in microseconds or nanoseconds.
fn wall_ns(text: &str) -> Option<i64> {
    let (seconds, fraction) = text.strip_prefix('(')?.strip_suffix(')')?.split_once('.')?;
    if ![seconds, fraction].iter().all(|part| part.bytes().all(|byte| byte.is_ascii_digit())) {
        return None;
    }
    let ns_per_digit = match fraction.len() {
        6 => 1_000,
        9 => 1,
        _ => return None,
    };
    let seconds: i64 = seconds.parse().ok()?;
    seconds.checked_mul(1_000_000_000)?.checked_add(fraction.parse::<i64>().ok()? * ns_per_digit)
}

/// What a frame is to us.
enum Seen {
    Ours(Frame),
    Foreign,
}

/// The grammar is that above `parse_canframe` in can-utils' `lib.h`; `None` for what does not follow it.
fn frame(text: &str) -> Option<Seen> {
    let (id, rest) = text.split_once('#')?;
    let number = u32::from_str_radix(id, 16).ok().filter(|_| !id.starts_with('+'))?;
    let identifier = |number: u32| u16::try_from(number).ok().and_then(Id::new);
    let built = |id: Id, format, payload: &[u8]| Frame::from_slice(id, format, payload).map(Seen::Ours);
    match id.len() {
        // CAN XL: priority and channel.
        5 => Some(Seen::Foreign),
        3 => {
            let id = identifier(number)?;
            if let Some(fd) = rest.strip_prefix('#') {
                let (flags, data) = fd.split_at_checked(1)?;
                let flags = u8::from_str_radix(flags, 16).ok()?;
                let format = Format::Fd { bit_rate_switch: flags & BIT_RATE_SWITCH != 0 };
                built(id, format, &bytes(data)?)
            } else if rest.starts_with(['R', 'r']) {
                Some(Seen::Foreign)
            } else {
                built(id, Format::Classic, &bytes(without_length_code(rest))?)
            }
        }
        8 if number & REPORT != 0 => match identifier(number & !REPORT) {
            Some(classes) => built(classes, Format::Report, &bytes(rest)?),
            // A class that is newer than this program.
            None => Some(Seen::Foreign),
        },
        8 => Some(Seen::Foreign),
        _ => None,
    }
}

/// Classic frames of 8 bytes may name a length code above 8, which changes nothing: `_E`.
fn without_length_code(data: &str) -> &str {
    let code = data.split_once('_').filter(|(bytes, code)| bytes.len() == 16 && code.len() == 1);
    code.map_or(data, |(bytes, _)| bytes)
}

/// Bytes of two hexadecimal digits each.
fn bytes(digits: &str) -> Option<Vec<u8>> {
    let digit = |byte: u8| char::from(byte).to_digit(16);
    let pairs = digits.as_bytes().chunks(2);
    pairs.map(|pair| Some((digit(*pair.first()?)? << 4 | digit(*pair.get(1)?)?) as u8)).collect()
}

/// Writes a frame that was seen at `wall_ns` nanoseconds since 1970.
pub fn write(out: &mut impl Write, wall_ns: i64, interface: &str, frame: &Frame) -> io::Result<()> {
    let us = wall_ns.max(0) / 1_000;
    write!(out, "({:010}.{:06}) {interface} ", us / 1_000_000, us % 1_000_000)?;
    let id = frame.id().raw();
    match frame.format() {
        Format::Classic => write!(out, "{id:03X}#")?,
        Format::Fd { bit_rate_switch } => {
            let flags = if bit_rate_switch { FD | BIT_RATE_SWITCH } else { FD };
            write!(out, "{id:03X}##{flags:X}")?;
        }
        Format::Report => write!(out, "{:08X}#", REPORT | u32::from(id))?,
    }
    for byte in frame.payload() {
        write!(out, "{byte:02X}")?;
    }
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Line>, TextError> {
        let mut lines = Lines::new(text.as_bytes());
        std::iter::from_fn(|| lines.next_frame().transpose()).collect()
    }

    fn one(text: &str) -> Option<Frame> {
        read(&format!("(1735270496.916858) can0 {text}\n")).unwrap().pop().map(|line| line.frame)
    }

    #[test]
    fn what_is_written_is_read_as_it_was() {
        let id = Id::from_low_bits(0x181);
        let frames = [
            Frame::classic(id, []),
            Frame::classic(Id::from_low_bits(0), [0xAB; 8]),
            Frame::fd(Id::MAX, [0x0F; 24]),
            Frame::from_slice(id, Format::Fd { bit_rate_switch: false }, &[7; 64]).unwrap(),
            Frame::report(Id::from_low_bits(0x204), [0, 0x30, 0, 0, 0, 0, 130, 0]),
        ];
        let mut text = Vec::new();
        for (place, frame) in (0..).zip(&frames) {
            write(&mut text, 1_735_270_496_000_000_999 + place * 1_000_000_000, "can0", frame).unwrap();
        }
        let lines = read(std::str::from_utf8(&text).unwrap()).unwrap();
        assert_eq!(lines.iter().map(|line| line.frame).collect::<Vec<_>>(), frames);
        let times: Vec<i64> = lines.iter().map(|line| line.wall_ns).collect();
        assert_eq!(times[..2], [1_735_270_496_000_000_000, 1_735_270_497_000_000_000], "cut to microseconds");
        assert_eq!(lines[4].number, 5);
        let mut early = Vec::new();
        write(&mut early, 7_000_120_999, "can0", &frames[0]).unwrap();
        assert_eq!(String::from_utf8(early).unwrap(), "(0000000007.000120) can0 181#\n");
    }

    #[test]
    fn the_text_is_that_of_candump() {
        // Captured with candump -L of can-utils 2020.11 on a vcan of Linux 6.1.
        const CAPTURED: &str = "\
(1795271469.607809) vcan0 080#2A000000
(1795271469.608852) vcan0 181##50F
(1795271469.608978) vcan0 20000004#0010000000000000
(1795271469.609097) vcan0 701#
(1795271469.609210) vcan0 181##4000000000000000000000000000000000000000000000000
";
        let id = Id::from_low_bits;
        let lines = read(CAPTURED).unwrap();
        let expected = [
            Frame::classic(id(0x080), [0x2A, 0, 0, 0]),
            Frame::fd(id(0x181), [0x0F]),
            Frame::report(id(0x004), [0, 0x10, 0, 0, 0, 0, 0, 0]),
            Frame::classic(id(0x701), []),
            Frame::from_slice(id(0x181), Format::Fd { bit_rate_switch: false }, &[0; 24]).unwrap(),
        ];
        assert_eq!(lines.iter().map(|line| line.frame).collect::<Vec<_>>(), expected);
        let mut text = Vec::new();
        for Line { wall_ns, interface, frame, .. } in &lines {
            // Candump cuts to microseconds, too.
            write(&mut text, wall_ns + 999, interface, frame).unwrap();
        }
        assert_eq!(String::from_utf8(text).unwrap(), CAPTURED);
    }

    #[test]
    fn what_options_of_candump_change_is_read_too() {
        let text = "(1735270496.916858)  can0 181#01 R\n(000.000007123) vcan10 181#02\r\n\
                    DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 7)\n\
                    (1735270496.916858) can0 181#0102030405060708_E\n(1735270496.916858) can0 181##1ab\n";
        let mut lines = Lines::new(text.as_bytes());
        let seen: Vec<Line> =
            std::iter::from_fn(|| lines.next_frame().transpose()).collect::<Result<_, _>>().unwrap();
        let at =
            |line: usize| (seen[line].wall_ns, seen[line].interface.as_str(), seen[line].frame.payload());
        assert_eq!(at(0), (1_735_270_496_916_858_000, "can0", &[1][..]));
        assert_eq!(at(1), (7_123, "vcan10", &[2][..]));
        assert_eq!(seen[2].frame, Frame::classic(Id::from_low_bits(0x181), [1, 2, 3, 4, 5, 6, 7, 8]));
        assert_eq!(seen[3].frame, Frame::fd(Id::from_low_bits(0x181), [0xAB]));
        assert_eq!((seen.len(), lines.dropped()), (4, 3));
    }

    #[test]
    fn what_is_none_of_ours_is_counted() {
        let foreign =
            ["104#R", "104#R8_9", "12345678#0011", "20001000#0000000000000000", "45123#81:00:12345678#11"];
        for text in foreign {
            assert_eq!(one(text), None, "{text}");
        }
        let text: String =
            foreign.iter().map(|frame| format!("(1735270496.916858) can0 {frame}\n")).collect();
        let mut lines = Lines::new(text.as_bytes());
        assert!(lines.next_frame().unwrap().is_none());
        assert_eq!(lines.passed_over(), 5);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let good = "(1735270496.916858) can0 181#01\n";
        for (bad, says) in [
            ("nonsense", "line 2: `nonsense` is no time"),
            ("", "line 2: `` is no time"),
            ("(1735270496.91685) can0 181#01", "line 2: `(1735270496.91685)` is no time"),
            ("(1735270496.+16858) can0 181#01", "is no time"),
            ("(99999999999.000000) can0 181#01", "is no time"),
            ("(1735270496.916858) can0", "line 2: it ends too early"),
            ("(1735270496.916858) can0 181", "line 2: `181` is no frame"),
            ("(1735270496.916858) can0 800#01", "`800#01` is no frame"),
            ("(1735270496.916858) can0 +81#01", "is no frame"),
            ("(1735270496.916858) can0 181#011", "is no frame"),
            ("(1735270496.916858) can0 181#0g", "is no frame"),
            ("(1735270496.916858) can0 181#010203040506070809", "is no frame"),
            ("(1735270496.916858) can0 181##", "is no frame"),
            ("(1735270496.916858) can0 181##1010203040506070809", "is no frame"),
            ("(1735270496.916858) can0 20000004#00", "is no frame"),
            ("(1735270496.916858) can0 181#01 X", "line 2: `X` stands behind the frame"),
        ] {
            let error = read(&format!("{good}{bad}\n{good}")).map(drop).unwrap_err().to_string();
            assert!(error.contains(says), "{bad}: {error}");
        }
    }

    #[test]
    fn a_text_without_lines_is_not_read_to_its_end() {
        let endless = vec![b'x'; 1 << 20];
        let mut lines = Lines::new(endless.as_slice());
        let error = lines.next_frame().map(drop).unwrap_err().to_string();
        assert!(error.len() < 300, "{error}");
        let unread = lines.text.buffer().len() + lines.text.get_ref().len();
        assert_eq!(unread, endless.len() - LINE_BYTES_MAX as usize);
    }
}
