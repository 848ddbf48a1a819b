import { create, toBinary } from "@bufbuild/protobuf";
import { describe, expect, it } from "vitest";
import { Assembler } from "../src/decode/assembler";
import { type ViewResponse, ViewResponseSchema } from "../src/gen/kerf/v1/view_pb";

function keyframe(topologyVersion: bigint): ViewResponse {
  return create(ViewResponseSchema, { number: 7n, message: { case: "keyframe", value: { topologyVersion } } });
}

function fragments(event: ViewResponse, bytes: number): ViewResponse[] {
  const data = toBinary(ViewResponseSchema, event);
  const count = Math.ceil(data.length / bytes);
  return Array.from({ length: count }, (_, index) => {
    const value = { data: data.slice(index * bytes, (index + 1) * bytes), remaining: count - 1 - index };
    return create(ViewResponseSchema, { message: { case: "fragment", value } });
  });
}

describe("fragments", () => {
  it("become the message that they were cut from", () => {
    const assembler = new Assembler();
    for (const bytes of [1, 2, 100]) {
      const parts = fragments(keyframe(300n), bytes);
      const taken = parts.map((part) => assembler.take(part));
      expect(taken.slice(0, -1).every((event) => event === undefined)).toBe(true);
      expect(taken.at(-1)).toEqual(keyframe(300n));
    }
  });

  it("that are missing are noticed, and the next message is taken", () => {
    const assembler = new Assembler();
    const [first, , third] = fragments(keyframe(300n), 2);
    assembler.take(first);
    expect(() => assembler.take(third)).toThrow("fragments");
    assembler.take(first);
    expect(() => assembler.take(keyframe(1n))).toThrow("fragments");
    expect(assembler.take(keyframe(2n))).toEqual(keyframe(2n));
  });
});
