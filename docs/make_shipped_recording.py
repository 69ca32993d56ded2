"""Makes the recording that ``highfive view`` plays: four high fives at half the rate, and no more than is shown."""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from highfive.hil.view import SHIPPED_RECORDING

THINNED = {"/person", "/avatar", "/tick", "/markers"}
"""Every other message of these; and of the forecasts those whose tick is kept."""
KEPT = THINNED | {"/forecast", "/session", "/trial", "/contact"}


def main() -> None:
    """Plays, and keeps what is needed of the recording."""
    with TemporaryDirectory() as folder:
        command = [
            "simulate",
            "--trials",
            "4",
            "--cell",
            "B2",
            "--seed",
            "0",
            "--no-pictures",
            "--out",
            folder + "/session",
        ]
        subprocess.run(
            [sys.executable, "-m", "highfive.hil.cli.main", *command], check=False, stdout=subprocess.DEVNULL
        )
        with Path(folder, "session", "session.mcap").open("rb") as file, SHIPPED_RECORDING.open("wb") as shipped:
            writer = Writer(shipped, compression=CompressionType.ZSTD)
            writer.start(profile="", library="high-five")
            channels: dict[str, int] = {}
            counts: dict[str, int] = {}
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
                topic = channel.topic
                counts[topic] = counts.get(topic, -1) + 1
                every_other = counts["/avatar" if topic == "/forecast" else topic]
                if topic not in KEPT or schema is None or (topic in THINNED | {"/forecast"} and every_other % 2):
                    continue
                if topic not in channels:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[topic] = writer.register_channel(topic, channel.message_encoding, number)
                writer.add_message(channels[topic], message.log_time, message.data, message.publish_time)
            writer.finish()


if __name__ == "__main__":
    main()
