"""Makes tests/corpus/views: view streams changed on purpose and at random, which decoders in every language replay.

    python tests/corpus/make_views.py

It needs the standard library alone and makes the same files each time. A file is a stream as in proto/vectors: each
ViewResponse behind its length. Its name says what was changed; those of sound streams end in "sound".
"""

import copy
import random
import struct
from pathlib import Path

FOLDER = Path(__file__).parent / "views"
VECTORS = Path(__file__).parents[2] / "proto/vectors"
MASK = 2**64 - 1
NAN, INFINITY = float("nan"), float("inf")

# Numbers and kinds of the fields that the streams have, as view.proto gives them. A kind that is a name is a message, a
# list of one a repeated message.
SCHEMA = {
    "ViewResponse": {
        "keyframe": (1, "Keyframe"), "patch": (2, "TopologyPatch"), "state": (3, "State"), "event": (4, "Event"),
        "hello": (6, "ViewHello"), "fragment": (7, "Fragment"), "number": (8, "varint"),
    },
    "ViewHello": {"protocol_version": (1, "varint"), "viewer": (3, "bytes")},
    "Event": {"step": (1, "varint")},
    "Fragment": {"data": (1, "bytes"), "remaining": (2, "varint")},
    "Keyframe": {
        "topology_version": (1, "varint"), "bodies": (2, ["BodyStructure"]), "surface_hash": (3, "fixed64"),
        "encoding": (4, "varint"),
    },
    "TopologyPatch": {
        "from_version": (1, "varint"), "to_version": (2, "varint"), "bodies": (3, ["BodyStructure"]),
        "surface_hash": (4, "fixed64"),
    },
    "BodyStructure": {
        "node_count": (1, "varint"), "node_ids": (2, "varints"), "node_rest_m": (3, "floats"),
        "element_ids": (4, "varints"), "element_nodes": (5, "varints"), "vertex_ids": (6, "varints"),
        "vertex_elements": (7, "varints"), "vertex_local": (8, "floats"), "quad_ids": (9, "varints"),
        "quad_vertices": (10, "varints"), "vertex_materials": (11, "varints"), "held_vertex_ids": (12, "varints"),
        "held_vertex_weights": (13, "floats"), "quantum_m": (14, "double"),
    },
    "State": {
        "topology_version": (1, "varint"), "step": (2, "varint"), "bodies": (4, ["BodyState"]),
        "reference_step": (9, "varint"), "has_reference": (10, "varint"),
    },
    "BodyState": {
        "displacements": (4, "bytes"), "reference": (5, "bytes"), "adapted_ids": (6, "bytes"),
        "adapted_offsets": (7, "bytes"), "normals": (8, "bytes"),
    },
}


def varint(value):
    data = bytearray()
    while value >= 0x80:
        data.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*data, value])


def delimited(number, data):
    return varint(number << 3 | 2) + varint(len(data)) + data


def field(number, kind, value):
    if isinstance(kind, list):
        return b"".join(delimited(number, encode(kind[0], one)) for one in value)
    if kind in SCHEMA:
        return delimited(number, encode(kind, value))
    if kind == "varint":
        return varint(number << 3) + varint(value)
    if kind == "fixed64":
        return varint(number << 3 | 1) + struct.pack("<Q", value)
    if kind == "double":
        return varint(number << 3 | 1) + struct.pack("<d", value)
    if kind == "varints":
        return delimited(number, b"".join(map(varint, value)))
    if kind == "floats":
        return delimited(number, struct.pack(f"<{len(value)}f", *value))
    return delimited(number, value)


def encode(kind, message):
    return b"".join(field(*SCHEMA[kind][name], value) for name, value in message.items())


def integers(values):
    """The integers of a `bytes` field, each zero by itself."""
    return b"".join(varint(value << 1 if value >= 0 else -2 * value - 1) + b"\0" * (value == 0) for value in values)


def hash_of(*words):
    state = 0
    for word in words:
        state = ((state ^ word) + 0x9E3779B97F4A7C15) & MASK
        state = (state ^ state >> 30) * 0xBF58476D1CE4E5B9 & MASK
        state = (state ^ state >> 27) * 0x94D049BB133111EB & MASK
        state ^= state >> 31
    return state


def bits(number):
    return struct.unpack("<I", struct.pack("<f", number))[0]


class Surface:
    """The hashes of one object's items by their ids, as a decoder that refuses nothing has them."""

    def __init__(self):
        self.vertices, self.held, self.quads = {}, {}, {}

    def change(self, body):
        def rows(ids, values, width):
            values = body.get(values, [])
            return [(id, values[width * i : width * (i + 1)]) for i, id in enumerate(body.get(ids, []))]

        materials = body.get("vertex_materials") or []
        elements = body.get("vertex_elements", [])
        for index, (id, local) in enumerate(rows("vertex_ids", "vertex_local", 3)):
            u, v, w = map(bits, [*local, 0, 0, 0][:3])
            element, material = [*elements, *[0] * 99][index], [*materials, *[0] * 99][index]
            self.vertices[id] = hash_of(id << 32 | element, u << 32 | v, material << 32 | w)
            self.held.pop(id, None)
        for id, weights in rows("held_vertex_ids", "held_vertex_weights", 8):
            a, b, c, d, e, f, g, h = map(bits, [*weights, *[0] * 8][:8])
            self.held[id] = hash_of(id << 32 | a, b << 32 | c, d << 32 | e, f << 32 | g, 1 << 49 | h)
        for id, corners in rows("quad_ids", "quad_vertices", 4):
            a, b, c, d = [*corners, *[0] * 4][:4]
            self.quads[id] = hash_of(id << 32 | a, b << 32 | c, 1 << 48 | d)

    def sum(self):
        return sum([*self.vertices.values(), *self.held.values(), *self.quads.values()]) & MASK


def encoded(stream):
    """The messages of a stream. Where one gives no hash it is that of what it says: only so do decoders get beyond it."""
    surfaces, messages = [], []
    for message in stream:
        message = copy.deepcopy(message)
        for name in ("keyframe", "patch"):
            structure = message.get(name)
            if structure is None:
                continue
            if name == "keyframe":
                surfaces = [Surface() for _ in structure["bodies"]]
            for surface, body in zip(surfaces, structure["bodies"]):
                surface.change(body)
            if structure.get("encoding") != 2:
                structure.setdefault("surface_hash", hash_of(*(surface.sum() for surface in surfaces)))
        messages.append(encode("ViewResponse", message))
    return messages


def save(name, messages):
    data = b"".join(struct.pack("<I", len(message)) + message for message in messages)
    (FOLDER / f"{name}.bin").write_bytes(data)


def recorded(name):
    file, messages, at = (VECTORS / f"{name}.bin").read_bytes(), [], 0
    while at < len(file):
        (length,) = struct.unpack_from("<I", file, at)
        messages.append(file[at + 4 : at + 4 + length])
        at += 4 + length
    return messages


# Places in the streams below.
HELLO, KEYFRAME, STATE, MOVED, PATCH, AFTER = range(6)
CORNERS_M = [[0.01 * (c & 1), 0.01 * (c >> 1 & 1), 0.01 * (c >> 2)] for c in range(8)]


def flat(rows):
    return [number for row in rows for number in row]


def state(version, step, slots, adapted):
    """Where all is after a step; the reference is that of step 1."""
    body = {"displacements": integers([step * slot for slot in range(3 * slots)])}
    if step == 1:
        body["reference"] = integers([5 - slot for slot in range(3 * slots)])
    if adapted:
        body["adapted_ids"] = integers([0, 2])
        body["adapted_offsets"] = integers([1, -2, 3, 0, 0, -70])
    of = {"topology_version": version, "step": step, "bodies": [body], "reference_step": 1}
    return {"state": {**of, "has_reference": 1} if step == 1 else of, "number": step}


def lattice():
    """One element, a quad on it, a vertex beside what is held; then a second element, and the quad's other side."""
    top = [[0, 1, 0], [1, 1, 0], [1, 1, 1], [0, 1, 1]]
    keyframe = {
        "node_count": 8, "node_ids": list(range(8)), "node_rest_m": flat(CORNERS_M),
        "element_ids": [0], "element_nodes": list(range(8)),
        "vertex_ids": [0, 1, 2, 3], "vertex_elements": [0] * 4, "vertex_local": flat(top),
        "vertex_materials": [0, 0, 1, 1],
        "held_vertex_ids": [1], "held_vertex_weights": [0.0, 0.0, 0.25, 0.5, 0.0, 0.0, 0.0, 0.0],
        "quad_ids": [2], "quad_vertices": [3, 2, 1, 0], "quantum_m": 5e-5,
    }
    patch = {
        "node_count": 12, "node_ids": [8, 9, 10, 11],
        "node_rest_m": flat([x, y + 0.01, z] for x, y, z in CORNERS_M[4:]),
        "element_ids": [1], "element_nodes": list(range(4, 12)),
        "vertex_ids": [4, 5, 6, 7], "vertex_elements": [1] * 4, "vertex_local": flat(top),
        "quad_ids": [3, 8], "quad_vertices": [4, 5, 6, 7, 0, 1, 5, 4],
    }
    return stream_of(keyframe, patch, 1)


def plain():
    """Two quads, then their other sides, as SURFACE_ENCODING_VERTICES has them."""
    keyframe = {
        "node_count": 8, "node_ids": list(range(8)), "node_rest_m": flat(CORNERS_M), "vertex_materials": [0, 1] * 4,
        "quad_ids": [2, 6], "quad_vertices": [0, 1, 3, 2, 4, 5, 7, 6], "quantum_m": 5e-5,
    }
    patch = {
        "node_count": 12, "node_ids": [8, 9, 10, 11], "node_rest_m": flat(CORNERS_M[4:]),
        "quad_ids": [3, 7], "quad_vertices": [2, 3, 1, 0, 8, 9, 11, 10],
    }
    return stream_of(keyframe, patch, 2)


def stream_of(keyframe, patch, encoding):
    is_lattice = encoding == 1
    return [
        {"hello": {"protocol_version": 3, "viewer": b"viewer-1"}},
        {"keyframe": {"topology_version": 0, "bodies": [keyframe], "encoding": encoding}, "number": 1},
        state(0, 1, 8, is_lattice),
        state(0, 2, 8, is_lattice),
        {"patch": {"from_version": 0, "to_version": 1, "bodies": [patch]}, "number": 3},
        state(1, 3, 12, is_lattice),
    ]


BASES = {"lattice": lattice, "plain": plain}
MOST, HALF, WRAPPING = 2**32 - 1, 2**29, 0x55555556
QUANTA = {"negative": -1e-5, "none": 0.0, "nan": NAN, "infinite": INFINITY, "huge": 1e308, "tiny": 5e-324}
# An integer of 64 bits at either end, and bytes that are no integers.
ENDS = [2**63 - 1, -(2**63)]
ENDLESS = b"\xff" * 1000

# By name: the streams, the message, and what its body's fields become.
BODIES = {
    # Of three times as many numbers 32 bits keep 2: room for none of them.
    "node-count-wraps": ("lattice plain", KEYFRAME, {"node_count": WRAPPING}),
    "node-count-largest": ("lattice plain", KEYFRAME, {"node_count": MOST}),
    "node-count-half-a-billion": ("lattice plain", KEYFRAME, {"node_count": HALF}),
    "node-count-none": ("lattice plain", KEYFRAME, {"node_count": 0}),
    "node-ids-descend": ("lattice plain", KEYFRAME, {"node_ids": [*range(6), 7, 6]}),
    "node-id-largest": ("lattice plain", KEYFRAME, {"node_ids": [*range(7), MOST]}),
    "node-rest-nan": ("lattice plain", KEYFRAME, {"node_rest_m": [NAN, *[0.0] * 23]}),
    "node-rest-infinite": ("lattice", KEYFRAME, {"node_rest_m": [-INFINITY, *[0.0] * 23]}),
    "node-rest-short": ("lattice plain", KEYFRAME, {"node_rest_m": [0.0] * 11}),
    "element-nodes-short": ("lattice", KEYFRAME, {"element_nodes": list(range(7))}),
    "element-nodes-unknown": ("lattice", KEYFRAME, {"element_nodes": [*range(7), 8]}),
    "element-node-without-rest": ("lattice", KEYFRAME, {"node_count": 9, "element_nodes": [*range(7), 8]}),
    "elements-none": ("lattice", KEYFRAME, {"element_ids": [], "element_nodes": []}),
    "vertex-elements-short": ("lattice", KEYFRAME, {"vertex_elements": [0] * 3}),
    "vertex-element-unknown": ("lattice", KEYFRAME, {"vertex_elements": [0, 0, 0, MOST]}),
    "vertex-ids-twice": ("lattice", KEYFRAME, {"vertex_ids": [0, 1, 1, 3]}),
    "vertex-local-nan": ("lattice", KEYFRAME, {"vertex_local": [NAN] * 12}),
    "vertex-local-huge": ("lattice", KEYFRAME, {"vertex_local": [3e38, -3e38] * 6}),
    "materials-short": ("lattice plain", KEYFRAME, {"vertex_materials": [0]}),
    "material-largest": ("lattice", KEYFRAME, {"vertex_materials": [0, 0, 0, MOST]}),
    "materials-largest": ("plain", KEYFRAME, {"vertex_materials": [MOST] * 8}),
    "held-vertex-unknown": ("lattice", KEYFRAME, {"held_vertex_ids": [9]}),
    "held-weights-nan": ("lattice", KEYFRAME, {"held_vertex_weights": [NAN] * 8}),
    "held-weights-short": ("lattice", KEYFRAME, {"held_vertex_weights": [0.5] * 7}),
    "quad-vertices-unknown": ("lattice plain", KEYFRAME, {"quad_ids": [2], "quad_vertices": [0, 1, 2, MOST]}),
    "quad-vertices-short": ("lattice plain", KEYFRAME, {"quad_vertices": [0, 1, 2]}),
    "quad-of-one-vertex": ("lattice plain", KEYFRAME, {"quad_ids": [2], "quad_vertices": [0] * 4}),
    "quad-id-largest": ("lattice plain", KEYFRAME, {"quad_ids": [MOST], "quad_vertices": [3, 2, 1, 0]}),
    "quad-ids-twice": ("plain", KEYFRAME, {"quad_ids": [2, 2], "quad_vertices": [0, 1, 3, 2] * 2}),
    **{f"quantum-{name}": ("lattice plain", KEYFRAME, {"quantum_m": of}) for name, of in QUANTA.items()},
    "patch-node-count-lowered": ("lattice plain", PATCH, {"node_count": 3}),
    "patch-node-count-wraps": ("lattice plain", PATCH, {"node_count": WRAPPING}),
    "patch-node-count-half-a-billion": ("lattice plain", PATCH, {"node_count": HALF}),
    "patch-of-vertices-there-are": ("lattice", PATCH, {"vertex_ids": [0, 1, 2, 3]}),
    "patch-quantum-nan": ("lattice", PATCH, {"quantum_m": NAN}),
    "patch-empty": ("lattice plain", PATCH, None),
    "state-empty": ("lattice plain", STATE, None),
    "displacements-long": ("lattice plain", MOVED, {"displacements": integers([1] * 25)}),
    "displacements-of-64-bits": ("lattice plain", MOVED, {"displacements": integers(ENDS * 12)}),
    "displacements-of-65-bits": ("lattice plain", MOVED, {"displacements": b"\xff" * 9 + b"\x02" + b"\x01" * 23}),
    "displacements-without-end": ("lattice plain", MOVED, {"displacements": ENDLESS}),
    "displacements-of-zeros-without-end": ("lattice plain", MOVED, {"displacements": b"\x80" * 1000}),
    "zeros-uncounted": ("lattice plain", MOVED, {"displacements": b"\x01" * 11 + b"\0"}),
    "zeros-2-to-the-64": ("lattice plain", MOVED, {"displacements": b"\0" + varint(MASK)}),
    "zeros-2-to-the-32": ("lattice plain", MOVED, {"displacements": b"\0" + varint(2**32 - 1)}),
    "reference-long": ("lattice plain", STATE, {"reference": integers([1] * 25)}),
    "reference-of-64-bits": ("lattice plain", STATE, {k: integers(ENDS * 12) for k in ("reference", "displacements")}),
    "reference-none": ("lattice plain", STATE, {"reference": b""}),
    "reference-without-end": ("lattice plain", STATE, {"reference": ENDLESS}),
    "adapted-unknown": ("lattice", MOVED, {"adapted_ids": integers([0, 9])}),
    "adapted-descending": ("lattice", MOVED, {"adapted_ids": integers([2, -1])}),
    "adapted-twice": ("lattice", MOVED, {"adapted_ids": integers([2, 0])}),
    "adapted-beyond-32-bits": ("lattice", MOVED, {"adapted_ids": integers([0, 2**32 + 2])}),
    "adapted-negative": ("lattice", MOVED, {"adapted_ids": integers([-1, 2])}),
    "adapted-beyond-64-bits": ("lattice", MOVED, {"adapted_ids": integers([2**63 - 1, 2**63 - 1])}),
    "adapted-zeros-2-to-the-40": ("lattice plain", MOVED, {"adapted_ids": b"\0" + varint(2**40)}),
    "adapted-offsets-short": ("lattice", MOVED, {"adapted_offsets": integers([1] * 5)}),
    "adapted-offsets-of-64-bits": ("lattice", MOVED, {"adapted_offsets": integers(ENDS * 3)}),
    "adapted-offsets-alone": ("lattice plain", MOVED, {"adapted_ids": b""}),
    "normals-odd": ("plain", MOVED, {"normals": b"\x80" * 7}),
}
# By name: the message, and what its own fields become.
MESSAGES = {
    "hash-of-another": (KEYFRAME, {"surface_hash": 1}),
    "encoding-unknown": (KEYFRAME, {"encoding": 99}),
    "encoding-negative": (KEYFRAME, {"encoding": MASK}),
    "version-largest": (KEYFRAME, {"topology_version": MASK}),
    "bodies-none": (KEYFRAME, {"bodies": []}),
    # Together they have fifty times the node slots that one message can be about.
    "bodies-300-of-a-million-nodes": (KEYFRAME, {"bodies": [{"node_count": 1000000, "quantum_m": 1.0}] * 300}),
    "patch-bodies-none": (PATCH, {"bodies": []}),
    "patch-from-the-future": (PATCH, {"from_version": 7, "to_version": 8}),
    "patch-to-itself": (PATCH, {"to_version": 0}),
    "state-bodies-none": (MOVED, {"bodies": []}),
    "state-from-the-future": (MOVED, {"topology_version": MASK}),
    "state-of-another-reference": (MOVED, {"reference_step": 77}),
    "state-without-the-first-reference": (STATE, {"has_reference": 0}),
}


def by_field():
    for base, make in BASES.items():
        save(f"{base}-sound", encoded(make()))
        for name, (bases, place, fields) in BODIES.items():
            if base not in bases.split():
                continue
            stream = make()
            (kind,) = set(stream[place]) - {"number"}
            body = stream[place][kind]["bodies"][0]
            stream[place][kind]["bodies"][0] = {} if fields is None else {**body, **fields}
            save(f"{base}-{name}", encoded(stream))
        for name, (place, fields) in MESSAGES.items():
            stream = make()
            (kind,) = set(stream[place]) - {"number"}
            stream[place][kind].update(fields)
            save(f"{base}-{name}", encoded(stream))
        stream = make()
        stream[KEYFRAME]["keyframe"]["bodies"] *= 2
        save(f"{base}-body-twice", encoded(stream))


def by_order():
    for base, make in BASES.items():
        stream = make()
        orders = {
            "keyframe-missing": [HELLO, STATE, PATCH, AFTER],
            "keyframe-twice": [HELLO, KEYFRAME, STATE, KEYFRAME, MOVED, STATE, PATCH, AFTER],
            "keyframe-after-patch": [HELLO, KEYFRAME, STATE, PATCH, KEYFRAME, AFTER, STATE],
            "patch-twice": [HELLO, KEYFRAME, PATCH, PATCH, STATE, AFTER],
            "state-before-keyframe": [STATE, AFTER, KEYFRAME, MOVED, STATE],
        }
        for name, order in orders.items():
            save(f"{base}-{name}", encoded([stream[place] for place in order]))


def by_fragments():
    hello, keyframe, *rest = encoded(lattice())
    parts = [keyframe[at : at + 150] for at in range(0, len(keyframe), 150)]
    count = len(parts)

    def fragment(data, remaining):
        return encode("ViewResponse", {"fragment": {"data": data, "remaining": remaining}})

    whole = [fragment(data, count - 1 - index) for index, data in enumerate(parts)]
    cases = {
        "sound": whole,
        "one-missing": [*whole[:1], *whole[2:]],
        "swapped": [whole[1], whole[0], *whole[2:]],
        "last-twice": [*whole, whole[-1]],
        "first-twice": [whole[0], *whole],
        "remaining-largest": [fragment(parts[0], MOST), *whole[1:]],
        "remaining-largest-later": [whole[0], fragment(parts[1], MOST), *whole[2:]],
        "remaining-none-at-once": [fragment(parts[0], 0), *whole[1:]],
        "empty": [fragment(b"", MOST), fragment(b"", MOST - 1), fragment(b"", 0), *whole],
        "broken-off": [*whole[:2], rest[0], *whole[2:]],
        "in-a-fragment": [fragment(whole[0], 0), *whole],
        "of-noise": [fragment(random.Random(1).randbytes(200), 0), *whole],
    }
    for name, messages in cases.items():
        save(f"fragments-{name}", [hello, *messages, *rest])


def by_wire():
    hello, keyframe, *rest = encoded(lattice())
    cases = {
        "empty": b"",
        "field-0": b"\x00\x01",
        "field-unknown": delimited(1000, b"?"),
        "field-of-another-type": varint(1 << 3) + varint(5),
        "varint-of-11-bytes": varint(8 << 3) + b"\xff" * 10 + b"\x01",
        "varint-without-end": varint(8 << 3) + b"\x80" * 3,
        "length-beyond-the-end": varint(1 << 3 | 2) + varint(1000) + b"\x08\x01",
        "length-of-64-bits": varint(1 << 3 | 2) + varint(MASK) + b"\x08\x01",
        "wire-type-7": b"\x0f\x01",
        "group-without-end": b"\x5b" * 3,
        "groups-nested": b"\x5b" * 2000 + b"\x5c" * 2000,
        "text-not-utf-8": delimited(6, delimited(3, b"\xff\xc0\x80")),
        "two-in-one": keyframe + rest[0],
        "floats-of-odd-length": delimited(1, delimited(2, delimited(3, b"\0" * 7))),
        "integers-unpacked": delimited(1, delimited(2, b"".join(varint(2 << 3) + varint(id) for id in range(4)))),
    }
    for name, message in cases.items():
        save(f"wire-{name}", [hello, message, keyframe, rest[0], message, *rest[1:]])


def fields_at_random(make, choose):
    """A stream in which one list of numbers of its structure has been changed, and the hash belongs to it."""
    stream = make()
    body = choose.choice([stream[KEYFRAME]["keyframe"], stream[PATCH]["patch"]])["bodies"][0]
    numbers = body[choose.choice([name for name, value in body.items() if isinstance(value, list) and value])]
    at, is_float = choose.randrange(len(numbers)), any(isinstance(number, float) for number in numbers)
    kind = choose.randrange(4)
    if kind == 0:
        numbers[at] = choose.choice([NAN, INFINITY, -1.0, 1e30] if is_float else [0, 1, 5, 8, 2**31, MOST])
    elif kind == 1:
        del numbers[at : at + choose.choice([1, 4, 8])]
    elif kind == 2:
        numbers[at:at] = numbers[: choose.choice([1, 4, 8])]
    else:
        choose.shuffle(numbers)
    return stream


def lengths(message, start=0, end=None):
    """Where the lengths of fields stand in a message, those of fields in fields too."""
    found, at = [], start
    end = len(message) if end is None else end

    def number():
        nonlocal at
        value = shift = 0
        while True:
            value |= (message[at] & 0x7F) << shift
            at, shift = at + 1, shift + 7
            if message[at - 1] < 0x80:
                return value

    try:
        while at < end:
            wire = number() & 7
            if wire == 0:
                number()
            elif wire == 1:
                at += 8
            elif wire == 5:
                at += 4
            elif wire == 2:
                place = at
                length = number()
                if at + length > end:
                    return []
                found += [place, *lengths(message, at, at + length)]
                at += length
            else:
                return []
    except IndexError:
        return []
    return found if at == end else []


WORDS = [b"\0", b"\xff", b"\x80\x80\x80\x80\x08", b"\xff\xff\xff\x7f", b"\0\0\xc0\x7f", b"\0" * 8]


def changed(kind, message, others, choose):
    data = bytearray(message)
    for _ in range(choose.randint(1, 3)):
        at = choose.randrange(len(data))
        if kind == "bits-flipped":
            data[at] ^= 1 << choose.randrange(8)
        elif kind == "runs-removed":
            del data[at : at + choose.randint(1, 16)]
            data = data or bytearray(1)
        elif kind == "words-put-in":
            data[at : at + choose.randrange(5)] = choose.choice(WORDS)
        elif kind == "runs-repeated":
            data[at:at] = data[at : at + choose.randint(1, 16)] * choose.randint(1, 4)
        elif kind == "lengths-changed":
            places = lengths(bytes(data))
            if places:
                place = choose.choice(places)
                data[place] = (data[place] + choose.choice([-2, -1, 1, 2, 64])) % 256
        elif kind == "spliced":
            other = choose.choice(others)
            data[at:] = other[choose.randrange(len(other)) :]
            data = data or bytearray(1)
        elif kind == "truncated":
            del data[at:]
            return bytes(data)
    return bytes(data)


def at_random():
    """Recorded streams. A state that is refused costs nothing but itself, so a keyframe serves for many of them."""
    kinds = [
        "bits-flipped", "runs-removed", "words-put-in", "runs-repeated", "lengths-changed", "spliced", "truncated",
    ]
    for seed, kind in enumerate(kinds):
        for name in ("cut", "cut-vertices"):
            choose = random.Random(f"{seed} {name}")
            messages = recorded(name)
            # The keyframe comes in two fragments, the state after it with its reference.
            hello, first, second, _, reference = messages[:5]
            states, patches = messages[5:16], [message for message in messages if message[0] >> 3 == 2]
            odd = [changed(kind, choose.choice(states), messages, choose) for _ in range(5)]
            last = [patches[0], *states[-2:], changed(kind, patches[0], messages, choose), states[-1]]
            save(f"{name}-{kind}", [hello, first, second, reference, *odd, *last])
    for base, make in BASES.items():
        choose = random.Random(base)
        streams = [fields_at_random(make, choose) for _ in range(20)]
        save(f"{base}-fields-at-random", [message for stream in streams for message in encoded(stream[KEYFRAME:])])
        choose = random.Random(f"bytes of {base}")
        messages = []
        for index in range(21):
            sound = encoded(make())[KEYFRAME:]
            target = choose.randrange(len(sound))
            sound[target] = changed(kinds[index % len(kinds)], sound[target], sound, choose)
            messages += sound
        save(f"{base}-bytes-at-random", messages)


FOLDER.mkdir(exist_ok=True)
for old in FOLDER.glob("*.bin"):
    if not old.name.startswith("found-"):
        old.unlink()
by_field()
by_order()
by_fragments()
by_wire()
at_random()
