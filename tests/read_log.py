"""Reads a log with the public MCAP packages and compares every number with its CSV export, and what the
cycles were told with a table of it.

    pip install mcap mcap-ros2-support
    python3 tests/read_log.py LOG.mcap TABLE.csv TOLD.csv

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


def told(message):
    """What an input says, as a line of the table of inputs."""
    payload = b"".join(word.to_bytes(8, "little") for word in message.payload)[: message.length]
    is_line = message.kind == 6
    return {
        "cycle": message.cycle,
        "kind": message.kind,
        "at_ns": message.at_ns,
        "identifier": message.identifier,
        "payload": payload.hex(),
        "target_x_m": message.values[1] if is_line else 0,
        "feed_m_per_s": message.values[4] if is_line else 0,
    }


def main(log, table, inputs):
    with open(log, "rb") as file, open(table, newline="") as text, open(inputs, newline="") as told_text:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        facts = {record.name: record.metadata for record in reader.iter_metadata()}["quadrant"]
        assert facts["format_version"] == "6", facts
        assert [attachment.name for attachment in reader.iter_attachments()] == ["machine.toml"]

        lines, told_lines = csv.DictReader(text), csv.DictReader(told_text)
        cycles = told_count = 0
        for _schema, channel, envelope, message in reader.iter_decoded_messages(log_time_order=False):
            if channel.topic == "/input":
                line, said = next(told_lines), told(message)
                assert line.keys() == said.keys(), said
                for column, cell in line.items():
                    same = cell == said[column] if column == "payload" else float(cell) == said[column]
                    assert same, f"input {told_count}, {column}: {said[column]} in the log, {cell} told"
                assert message.cycle == cycles, f"the input of cycle {message.cycle} stands at cycle {cycles}"
                told_count += 1
                continue
            line = next(lines)
            assert channel.topic == "/cycle", channel.topic
            at = int(facts["wall_at_zero_ns"]) + message.scheduled_ns
            assert envelope.log_time == envelope.publish_time == at, f"message {cycles} at {envelope.log_time} ns"
            for column, cell in line.items():
                read, exported = value(message, column), float(cell)
                same = read == exported or (math.isnan(read) and math.isnan(exported))
                assert same, f"line {cycles}, {column}: {read} in the log, {exported} in the table"
            cycles += 1
        assert next(lines, None) is None, f"the table goes on after {cycles} cycles"
        assert next(told_lines, None) is None, f"the cycles were told more than {told_count} inputs"
        assert reader.get_summary().statistics.message_count == cycles + told_count
        print(f"{cycles} cycles of {len(line)} numbers and {told_count} inputs, all equal")


if __name__ == "__main__":
    main(*sys.argv[1:])
