//! What is in a chunk, after its checksum held.
//!
//! Invariant: not one record of a chunk is handed out before all of the chunk is known to be whole.

use mcap::McapError;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::frame::{BODY_BYTES_MAX, HEAD_BYTES};

/// Length and name of the compression, as in every chunk of ours.
pub(super) const SIGNATURE: &[u8] = b"\x04\0\0\0zstd";
/// Where it stands in a chunk: after head, start, end, length and checksum.
pub(super) const SIGNATURE_AT: usize = HEAD_BYTES + 28;

/// Whether the bytes of a record are those of a chunk, whatever its type says: a chunk with a damaged type
/// would be passed over in silence where no checksum covers the section.
pub(super) fn is_chunk(record: &[u8]) -> bool {
    record.get(SIGNATURE_AT..).is_some_and(|rest| rest.starts_with(SIGNATURE))
}

/// Where the checksum stands in a chunk record: after start time, end time and length.
const CHECKSUM_AT: usize = HEAD_BYTES + 24;

/// Gives every record of the chunk to `each`, as opcode and body, until it returns an error.
pub(super) fn open<E: From<String>>(
    chunk: &[u8],
    mut each: impl FnMut(u8, &[u8]) -> Result<(), E>,
) -> Result<(), E> {
    // MCAP reads zero as "not checked"; we always check. One honest chunk in 2^32 has this
    // checksum and is given up for it.
    if chunk.get(CHECKSUM_AT..CHECKSUM_AT + 4).is_none_or(|checksum| checksum == [0; 4]) {
        return Err("the chunk has no checksum".to_owned().into());
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(BODY_BYTES_MAX as usize);
    let mut reader = LinearReader::new_with_options(options);
    let mut rest = chunk;
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| describe(&error))? {
            LinearReadEvent::ReadRequest(wanted) => {
                let (now, later) = rest.split_at(wanted.min(rest.len()));
                reader.insert(now.len()).copy_from_slice(now);
                reader.notify_read(now.len());
                rest = later;
            }
            LinearReadEvent::Record { opcode, data } => each(opcode, data)?,
        }
    }
    Ok(())
}

fn describe(error: &McapError) -> String {
    format!("the chunk cannot be opened: {error}")
}
