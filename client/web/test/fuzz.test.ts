// Streams that were changed: a decoder refuses what it cannot use in its own words. Those of tests/corpus/views are
// replayed, as every client does; those of proto/vectors are changed at random.

import { readdirSync, readFileSync } from "node:fs";
import { fromBinary } from "@bufbuild/protobuf";
import { expect, test } from "vitest";
import { Assembler } from "../src/decode/assembler";
import { MAX_NODES } from "../src/decode/body";
import { ReplicaError } from "../src/decode/check";
import { Replica } from "../src/decode/replica";
import { BodySurface } from "../src/decode/surface";
import { type ViewResponse, ViewResponseSchema } from "../src/gen/kerf/v1/view_pb";

/** How long each stream is changed, s. */
const SECONDS = Number(process.env.FUZZ_SECONDS ?? 2);
const FIRST_SEED = Number(process.env.FUZZ_SEED ?? 1);
const MAX_CHANGES = 4;
/** Longest that a stream of the corpus may take, ms, on a busy machine; they take milliseconds. */
const PATIENCE_MS = 20_000;
const CORPUS = new URL("../../../tests/corpus/views/", import.meta.url);
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

function messagesOf(file: Buffer): Uint8Array[] {
  const messages: Uint8Array[] = [];
  for (let at = 0; at < file.length; ) {
    const from = at + 4;
    at = from + file.readUInt32LE(at);
    messages.push(file.subarray(from, at));
  }
  return messages;
}

/** What a viewer does with a stream; answers with how many messages were applied, and how many refused. */
function show(messages: Uint8Array[], stream: string): { applied: number; refused: number } {
  const [assembler, replica] = [new Assembler(), new Replica()];
  let refused = 0;
  messages.forEach((message, index) => {
    const event = decoded(message);
    const take = (event: ViewResponse) => {
      const whole = assembler.take(event);
      if (whole) apply(replica, whole);
    };
    if (!event || refuses(() => take(event), `${stream}, message ${index}`)) refused++;
    const nodes = replica.bodies.reduce((sum, body) => sum + body.nodeCount, 0);
    expect(nodes, `${stream}, message ${index}`).toBeLessThanOrEqual(MAX_NODES);
  });
  return { applied: messages.length - refused, refused };
}

test.each(readdirSync(CORPUS).filter((name) => name.endsWith(".bin")))(
  "%s of the corpus is refused by words or shown",
  (name) => {
    const messages = messagesOf(readFileSync(new URL(name, CORPUS)));
    const { refused } = show(messages, name);
    if (name.endsWith("sound.bin")) expect(refused).toBe(0);
  },
  PATIENCE_MS,
);

test.each(["cut", "cut-vertices"])(
  "%s, changed, is refused by words or shown",
  (name) => {
    const messages = messagesOf(readFileSync(new URL(`../../../proto/vectors/${name}.bin`, import.meta.url)));
    expect(show(messages, name).refused).toBe(0);
    const ends = Date.now() + 1000 * SECONDS;
    let [applied, refused] = [0, 0];
    for (let seed = FIRST_SEED; Date.now() < ends; seed++) {
      const below = random(seed);
      // What follows a change meets what it has left.
      const target = below(messages.length);
      const stream = messages.map((message, index) => (index === target ? changed(message, below) : message));
      const counts = show(stream, `FUZZ_SEED=${seed}`);
      applied += counts.applied;
      refused += counts.refused;
    }
    expect(applied).toBeGreaterThan(0);
    expect(refused).toBeGreaterThan(0);
  },
  1000 * (SECONDS + 30),
);
