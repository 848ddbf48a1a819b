"""The recorded streams of proto/vectors, changed at random: a replica refuses what it cannot use in its own words."""

import os
import random
import struct
import time
from pathlib import Path

import pytest
from google.protobuf.message import DecodeError

from kerf.errors import ReplicaError
from kerf.replica import Assembler, Replica
from kerf.v1 import view_pb2 as pb

SECONDS = float(os.environ.get("FUZZ_SECONDS", 2))
FIRST_SEED = int(os.environ.get("FUZZ_SEED", 1))
WORDS = [b"\0", b"\xff", b"\x80\x80\x80\x80\x08", b"\xff" * 4, b"\0\0\xc0\x7f"]


def recorded(name):
    file = (Path(__file__).parents[3] / "proto/vectors" / name).read_bytes()
    messages, at = [], 0
    while at < len(file):
        (length,) = struct.unpack_from("<I", file, at)
        messages.append(file[at + 4 : at + 4 + length])
        at += 4 + length
    return messages


def changed(message, choose):
    data = bytearray(message)
    for _ in range(choose.randint(0, 4)):
        at = choose.randrange(len(data) + 1)
        kind = choose.randrange(4)
        if kind == 0 and at < len(data):
            data[at] ^= 1 << choose.randrange(8)
        elif kind == 1:
            del data[at : at + choose.randint(1, 16)]
        elif kind == 2:
            data[at : at + choose.randrange(5)] = choose.choice(WORDS)
        elif kind == 3:
            data[at:at] = data[at : at + choose.randrange(16)]
    return bytes(data)


@pytest.mark.parametrize("name", ["cut.bin", "cut-vertices.bin"])
def test_a_changed_stream_is_refused_by_words_or_shown(name):
    messages = recorded(name)
    ends = time.monotonic() + SECONDS
    applied = refused = 0
    seed = FIRST_SEED
    while time.monotonic() < ends:
        choose = random.Random(seed)
        assembler, replica = Assembler(), Replica(["block", "other"])
        # What follows a change meets what it has left.
        target = choose.randrange(len(messages))
        for index, message in enumerate(messages):
            data = changed(message, choose) if index == target else message
            try:
                event = pb.ViewResponse.FromString(data)
            except DecodeError:
                # Not of the protocol: its library says so.
                refused += 1
                continue
            try:
                whole = assembler.take(event)
                if whole is not None:
                    replica.apply(whole)
                    if replica.step is not None:
                        replica.surfaces()
                applied += 1
            except ReplicaError:
                refused += 1
            except Exception as error:
                raise AssertionError(f"FUZZ_SEED={seed}, message {index}") from error
        seed += 1
    assert applied > 0
    assert refused > 0
