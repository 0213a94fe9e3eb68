//! Numbers to bytes and back, as CDR (the OMG's common data representation, XCDR version 1, little
//! endian): a four-byte head, then the values in order, each aligned to its own size counted from
//! the end of the head.
//!
//! Invariant: no allocation once the buffer has grown to one record; reading never leaves the bytes.

use std::fmt::Debug;
use std::io::Write;

/// Little endian, plain encoding, no options.
const HEAD: [u8; 4] = [0, 1, 0, 0];
/// A place for zeros between values: alignment never asks for more than seven.
const PADDING: [u8; 8] = [0; 8];

/// A number as it stands in a message.
pub(super) trait Wire: Copy + Debug {
    /// Its name in a `ros2msg` schema.
    const NAME: &'static str;
    /// Its size, which is also its alignment, in bytes.
    const BYTES: usize;
    /// Adds its bytes.
    fn append(self, bytes: &mut Vec<u8>);
    /// From exactly [`Self::BYTES`] bytes.
    fn from_bytes(bytes: &[u8]) -> Self;
    /// Adds it as decimal text; floating point with as many digits as it takes to read it back.
    fn append_text(self, text: &mut Vec<u8>) {
        write!(text, "{self:?}").expect("a vector takes any write");
    }
}

macro_rules! wire {
    ($($kind:ty: $name:literal),+ $(,)?) => {$(
        impl Wire for $kind {
            const NAME: &'static str = $name;
            const BYTES: usize = size_of::<$kind>();
            fn append(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
            fn from_bytes(bytes: &[u8]) -> Self {
                Self::from_le_bytes(bytes.try_into().expect("the caller cut exactly this many bytes"))
            }
        }
    )+};
}
wire!(u8: "uint8", u16: "uint16", u32: "uint32", u64: "uint64", i32: "int32", i64: "int64", f64: "float64");

impl Wire for bool {
    const NAME: &'static str = "bool";
    const BYTES: usize = 1;
    fn append(self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(self));
    }
    fn from_bytes(bytes: &[u8]) -> Self {
        bytes != [0]
    }
    fn append_text(self, text: &mut Vec<u8>) {
        text.push(b'0' + u8::from(self));
    }
}

/// Takes the values of a record in order.
pub(super) trait Sink {
    /// The next value.
    fn put<W: Wire>(&mut self, value: W);
}

/// Builds one message at a time in the same buffer.
#[derive(Debug, Default)]
pub(super) struct Encoder {
    bytes: Vec<u8>,
}

impl Encoder {
    /// A new message; the last one is gone.
    pub(super) fn restart(&mut self) {
        self.bytes.clear();
        self.bytes.extend_from_slice(&HEAD);
    }
    /// The message so far.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

impl Sink for Encoder {
    fn put<W: Wire>(&mut self, value: W) {
        let gap = padding(self.bytes.len(), W::BYTES);
        self.bytes.extend_from_slice(&PADDING[..gap]);
        value.append(&mut self.bytes);
    }
}

/// Reads one message from its start.
#[derive(Debug)]
pub(super) struct Decoder<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Decoder<'a> {
    /// `None` when the message is not plain little-endian CDR.
    pub(super) fn new(bytes: &'a [u8]) -> Option<Self> {
        bytes.starts_with(&HEAD).then_some(Self { bytes, at: HEAD.len() })
    }
    /// The next value; `None` past the end.
    pub(super) fn take<W: Wire>(&mut self) -> Option<W> {
        let start = self.at + padding(self.at, W::BYTES);
        self.at = start + W::BYTES;
        self.bytes.get(start..self.at).map(W::from_bytes)
    }
    /// Every byte was read.
    pub(super) fn is_at_end(&self) -> bool {
        self.at == self.bytes.len()
    }
}

/// Zeros before a value of `align` bytes at `at` bytes from the start of the message.
const fn padding(at: usize, align: usize) -> usize {
    (align - (at - HEAD.len()) % align) % align
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_where_the_standard_wants_them() {
        let mut encoder = Encoder::default();
        encoder.restart();
        encoder.put(7_u8);
        encoder.put(-2.0_f64); // aligned to 8 from the end of the head, not of the message
        encoder.put(true);
        encoder.put(0x0102_u16);
        let mut expected = vec![0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
        expected.extend((-2.0_f64).to_le_bytes());
        expected.extend([1, 0, 2, 1]);
        assert_eq!(encoder.bytes(), expected);

        let mut decoder = Decoder::new(encoder.bytes()).unwrap();
        assert_eq!(decoder.take::<u8>(), Some(7));
        assert_eq!(decoder.take::<f64>(), Some(-2.0));
        assert_eq!(decoder.take::<bool>(), Some(true));
        assert_eq!(decoder.take::<u16>(), Some(0x0102));
        assert!(decoder.is_at_end());
        assert_eq!(decoder.take::<u8>(), None);
    }

    #[test]
    fn a_big_endian_message_is_refused() {
        assert!(Decoder::new(&[0, 0, 0, 0, 7]).is_none());
    }
}
