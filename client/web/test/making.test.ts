import { create } from "@bufbuild/protobuf";
import { expect, test } from "vitest";
import { MakingProgressSchema, MakingStage } from "../src/gen/kerf/v1/session_pb";
import { inPlainWords } from "../src/net/making";

test("what the server does to the tissue is said in plain words", () => {
  const told = (stage: MakingStage, voxels: bigint, objects = 1) =>
    inPlainWords(create(MakingProgressSchema, { stage, voxels, objects, object: objects - 1 }));
  expect(told(MakingStage.READING, 0n, 0)).toBe("The server reads the scene…");
  expect(told(MakingStage.VOXELS, 0n)).toBe("The server makes the tissue: fills its voxels…");
  expect(told(MakingStage.EQUILIBRIUM, 32525n, 2)).toBe(
    "The server makes tissue 2 of 2, 32,525 voxels: lets it settle under its tension…",
  );
});
