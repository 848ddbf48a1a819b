"""Streams that were changed: a replica refuses what it cannot use in its own words.

Those of `tests/corpus/views` are replayed, as every client does; those of `proto/vectors` are changed at random.
"""

import os
import random
import struct
import time
import tracemalloc
from pathlib import Path

import pytest
from google.protobuf.message import DecodeError

from kerf import integers
from kerf.errors import ReplicaError
from kerf.replica import Assembler, Replica
from kerf.v1 import view_pb2 as pb

ROOT = Path(__file__).parents[3]
CORPUS = ROOT / "tests/corpus/views"
SECONDS = float(os.environ.get("FUZZ_SECONDS", 2))
FIRST_SEED = int(os.environ.get("FUZZ_SEED", 1))
#: Longest that a stream may take, s, on a busy machine; they take milliseconds.
PATIENCE_S = 20.0
#: Most that a stream may take, bytes: more than an object of as many nodes as may be does.
MEMORY = 256 << 20
WORDS = [b"\0", b"\xff", b"\x80\x80\x80\x80\x08", b"\xff" * 4, b"\0\0\xc0\x7f"]


def read(path):
    file = path.read_bytes()
    messages, at = [], 0
    while at < len(file):
        (length,) = struct.unpack_from("<I", file, at)
        messages.append(file[at + 4 : at + 4 + length])
        at += 4 + length
    return messages


def show(messages):
    """What a viewer does with a stream; answers with how many messages were applied, and how many refused."""
    assembler, replica = Assembler(), Replica(["block"])
    applied = refused = 0
    for index, message in enumerate(messages):
        try:
            whole = assembler.take(pb.ViewResponse.FromString(message))
            if whole is not None:
                replica.apply(whole)
                if replica.step is not None:
                    replica.surfaces()
            applied += 1
        except (ReplicaError, DecodeError):
            # What is not of the protocol is refused by its library.
            refused += 1
        except Exception as error:
            raise AssertionError(f"message {index}") from error
    return applied, refused


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


@pytest.mark.parametrize("path", sorted(CORPUS.glob("*.bin")), ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning", "ignore:invalid value:RuntimeWarning")
def test_a_stream_of_the_corpus_is_refused_by_words_or_shown(path):
    messages = read(path)
    began = time.monotonic()
    tracemalloc.start()
    try:
        _, refused = show(messages)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert refused == 0 or not path.stem.endswith("sound")
    assert time.monotonic() - began < PATIENCE_S
    assert most < MEMORY


def test_an_integer_without_an_end_is_refused_at_once():
    began = time.monotonic()
    with pytest.raises(ReplicaError, match="displacements: not integers of 64 bits"):
        integers.decode("displacements", b"\xff" * (1 << 20), 24)
    assert time.monotonic() - began < PATIENCE_S / 4


@pytest.mark.parametrize("name", ["cut.bin", "cut-vertices.bin"])
def test_a_changed_stream_is_refused_by_words_or_shown(name):
    messages = read(ROOT / "proto/vectors" / name)
    assert show(messages) == (len(messages), 0)
    ends = time.monotonic() + SECONDS
    applied = refused = 0
    seed = FIRST_SEED
    while time.monotonic() < ends:
        choose = random.Random(seed)
        # What follows a change meets what it has left.
        target = choose.randrange(len(messages))
        data = changed(messages[target], choose)
        try:
            counts = show([*messages[:target], data, *messages[target + 1 :]])
        except AssertionError as error:
            raise AssertionError(f"FUZZ_SEED={seed}, message {target} was changed") from error
        applied, refused, seed = applied + counts[0], refused + counts[1], seed + 1
    assert applied > 0
    assert refused > 0
