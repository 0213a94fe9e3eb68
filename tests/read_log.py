"""Reads a log with the public MCAP packages and compares every number with its CSV export.

    pip install mcap mcap-ros2-support
    python3 tests/read_log.py LOG.mcap TABLE.csv

Ends with an error when a count, a name or a number differs, or a checksum of the file does not hold.
"""

import csv
import math
import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


def value(message, column):
    """The number of a column such as `cycle` or `x.setpoint_position_m`."""
    for name in column.split("."):
        message = getattr(message, name)
    return float(message)


def main(log, table):
    with open(log, "rb") as file, open(table, newline="") as text:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        facts = {record.name: record.metadata for record in reader.iter_metadata()}["quadrant"]
        assert facts["format_version"] == "4", facts
        assert [attachment.name for attachment in reader.iter_attachments()] == ["machine.toml"]

        lines = csv.DictReader(text)
        count = 0
        for _schema, channel, envelope, message in reader.iter_decoded_messages():
            line = next(lines)
            assert channel.topic == "/cycle", channel.topic
            at = int(facts["wall_at_zero_ns"]) + message.scheduled_ns
            assert envelope.log_time == envelope.publish_time == at, f"message {count} at {envelope.log_time} ns"
            for column, cell in line.items():
                read, exported = value(message, column), float(cell)
                same = read == exported or (math.isnan(read) and math.isnan(exported))
                assert same, f"line {count}, {column}: {read} in the log, {exported} in the table"
            count += 1
        assert next(lines, None) is None, f"the table goes on after {count} messages"
        assert reader.get_summary().statistics.message_count == count
        print(f"{count} messages, {len(line)} numbers each, all equal")


if __name__ == "__main__":
    main(*sys.argv[1:])
