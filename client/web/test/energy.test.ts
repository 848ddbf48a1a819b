import { create } from "@bufbuild/protobuf";
import { expect, test } from "vitest";
import { EnergyLedgerSchema } from "../src/gen/kerf/v1/session_pb";
import { energyOf } from "../src/net/energy";

test("lost energy is never below zero: what steps made is an error", () => {
  const lost = energyOf(create(EnergyLedgerSchema, { dampingJ: 3, frictionJ: 1, contactLossJ: -0.5, residualJ: -0.25 }));
  expect([lost.dissipatedJ, lost.errorJ]).toEqual([3.5, 0.25]);
  const made = energyOf(create(EnergyLedgerSchema, { dampingJ: 1, contactLossJ: -3, residualJ: -0.25 }));
  expect([made.dissipatedJ, made.errorJ]).toEqual([0, 2.25]);
});
