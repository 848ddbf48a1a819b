// The server's books as the page shows them.

import type { EnergyLedger } from "../gen/kerf/v1/session_pb";
import type { Energy } from "./frames";

type Booked = Omit<EnergyLedger, "$typeName" | "$unknown">;

/** Steps lose a little energy, and now and then gain some: a gain is an error of theirs, and no heat. */
export function energyOf(ledger: Booked): Energy {
  const { toolWorkJ, elasticJ, fractureJ, dampingJ, frictionJ, contactLossJ, numericalJ, residualJ } = ledger;
  const lostJ = dampingJ + frictionJ + contactLossJ + numericalJ;
  return {
    toolWorkJ,
    elasticJ,
    fractureJ,
    dissipatedJ: Math.max(0, lostJ),
    errorJ: Math.abs(residualJ + Math.min(0, lostJ)),
  };
}
