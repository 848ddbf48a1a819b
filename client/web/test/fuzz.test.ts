// The recorded streams of proto/vectors, changed at random: a decoder refuses what it cannot use in its own words.

import { readFileSync } from "node:fs";
import { fromBinary } from "@bufbuild/protobuf";
import { expect, test } from "vitest";
import { Assembler } from "../src/decode/assembler";
import { ReplicaError } from "../src/decode/check";
import { Replica } from "../src/decode/replica";
import { BodySurface } from "../src/decode/surface";
import { type ViewResponse, ViewResponseSchema } from "../src/gen/kerf/v1/view_pb";

/** How long each stream is changed, s. */
const SECONDS = Number(process.env.FUZZ_SECONDS ?? 2);
const FIRST_SEED = Number(process.env.FUZZ_SEED ?? 1);
const MAX_CHANGES = 4;
const WORDS = [[0], [0xff], [0x80, 0x80, 0x80, 0x80, 0x08], [0xff, 0xff, 0xff, 0xff], [0, 0, 0xc0, 0x7f]];

/** mulberry32: the same numbers for the same seed. */
function random(seed: number): (below: number) => number {
  return (below) => {
    seed = (seed + 0x6d2b79f5) | 0;
    let mixed = Math.imul(seed ^ (seed >>> 15), 1 | seed);
    mixed = (mixed + Math.imul(mixed ^ (mixed >>> 7), 61 | mixed)) ^ mixed;
    return Math.floor((((mixed ^ (mixed >>> 14)) >>> 0) / 2 ** 32) * below);
  };
}

function changed(message: Uint8Array, below: (below: number) => number): Uint8Array {
  const bytes = [...message];
  for (let change = below(MAX_CHANGES + 1); change > 0; change--) {
    const at = below(bytes.length);
    const kind = below(4);
    if (kind === 0) bytes[at] ^= 1 << below(8);
    if (kind === 1) bytes.splice(at, 1 + below(16));
    if (kind === 2) bytes.splice(at, below(5), ...WORDS[below(WORDS.length)]);
    if (kind === 3) bytes.splice(at, 0, ...bytes.slice(at, at + below(16)));
  }
  return Uint8Array.from(bytes);
}

function decoded(message: Uint8Array): ViewResponse | undefined {
  try {
    return fromBinary(ViewResponseSchema, message);
  } catch {
    // Not of the protocol: its library says so.
    return undefined;
  }
}

function apply(replica: Replica, { message }: ViewResponse): void {
  if (message.case === "keyframe") replica.applyKeyframe(message.value);
  if (message.case === "patch") replica.applyPatch(message.value);
  if (message.case === "state") replica.applyState(message.value);
  for (const surface of replica.bodies.map((body) => new BodySurface(body))) {
    surface.restructure();
    surface.shape();
  }
}

/** Runs what may refuse, in its own words alone; answers whether it did. */
function refuses(what: () => void, place: string): boolean {
  try {
    what();
    return false;
  } catch (error) {
    if (!(error instanceof ReplicaError)) throw new Error(place, { cause: error });
    return true;
  }
}

test.each(["cut", "cut-vertices"])(
  "%s, changed, is refused by words or shown",
  (name) => {
    const file = readFileSync(new URL(`../../../proto/vectors/${name}.bin`, import.meta.url));
    const messages: Uint8Array[] = [];
    for (let at = 0; at < file.length; ) {
      const from = at + 4;
      at = from + file.readUInt32LE(at);
      messages.push(file.subarray(from, at));
    }
    const ends = Date.now() + 1000 * SECONDS;
    let [applied, refused] = [0, 0];
    for (let seed = FIRST_SEED; Date.now() < ends; seed++) {
      const below = random(seed);
      const [assembler, replica] = [new Assembler(), new Replica()];
      // What follows a change meets what it has left.
      const target = below(messages.length);
      messages.forEach((message, index) => {
        const event = decoded(index === target ? changed(message, below) : message);
        const place = `FUZZ_SEED=${seed}, message ${index}`;
        const isRefused = refuses(() => {
          let whole: ViewResponse | undefined;
          if (event) whole = assembler.take(event);
          if (whole) apply(replica, whole);
        }, place);
        if (isRefused) refused++;
        else applied++;
      });
    }
    expect(applied).toBeGreaterThan(0);
    expect(refused).toBeGreaterThan(0);
  },
  1000 * (SECONDS + 30),
);
