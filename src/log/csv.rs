//! A log as a table: one line per cycle, one column per field, the first line names them with their
//! units. Floating point is written with as many digits as it takes to read the same number back.
//!
//! Invariant: one record in memory at a time; columns and values come from the one table of fields.

use std::io::{Read, Seek, Write};
use std::path::Path;

use super::cdr::{Sink, Wire};
use super::error::LogError;
use super::reader::Reader;
use super::schema;

/// Writes every record of `log` to `table`, and says how many. `file` names the table in messages.
///
/// # Errors
/// What the reader meets, after everything before it was written; a table that cannot be written.
pub fn export<R: Read + Seek>(log: &mut Reader<R>, table: impl Write, file: &Path) -> Result<u64, LogError> {
    let mut table = ::csv::Writer::from_writer(table);
    let refused = |error: ::csv::Error| LogError::io(file, "write")(error.into());
    table.write_record(schema::columns(&log.header().axes)).map_err(refused)?;
    let mut line = Line::default();
    let mut lines = 0;
    for record in log {
        let record = record.inspect_err(|_| drop(table.flush()))?;
        line.cells.clear();
        schema::put(&record, &mut line);
        table.write_byte_record(&line.cells).map_err(refused)?;
        lines += 1;
    }
    table.flush().map_err(LogError::io(file, "write"))?;
    Ok(lines)
}

/// One line, in buffers that are used again.
#[derive(Default)]
struct Line {
    cells: ::csv::ByteRecord,
    text: Vec<u8>,
}

impl Sink for Line {
    fn put<W: Wire>(&mut self, value: W) {
        self.text.clear();
        value.append_text(&mut self.text);
        self.cells.push_field(&self.text);
    }
}
