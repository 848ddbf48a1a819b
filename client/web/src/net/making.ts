// A session that is made, and how far it is while it is.

import { Code, ConnectError } from "@connectrpc/connect";
import {
  type MakeSessionResponse,
  type MakingProgress,
  MakingStage,
  type SessionDescription,
} from "../gen/kerf/v1/session_pb";

const STAGES: Partial<Record<MakingStage, string>> = {
  [MakingStage.VOXELS]: "fills its voxels",
  [MakingStage.ELEMENTS]: "joins voxels to elements",
  [MakingStage.SOLVER]: "sets up the solver",
  [MakingStage.EQUILIBRIUM]: "lets it settle under its tension",
};

/** The session that is made at last; tells until then how far it is, 0 to 1, and what is done. */
export async function made(
  answers: AsyncIterable<MakeSessionResponse>,
  tell: (share: number, what: string) => void,
): Promise<SessionDescription> {
  for await (const { state } of answers) {
    if (state.case === "created") return state.value.session!;
    if (state.case === "progress") tell(state.value.share, inPlainWords(state.value));
  }
  throw new ConnectError("the server ended the call without a session", Code.Unavailable);
}

/** What the server does to the tissue. */
export function inPlainWords({ stage, object, objects, voxels }: MakingProgress): string {
  const work = STAGES[stage];
  if (work === undefined) return "The server reads the scene…";
  const which = objects > 1 ? `tissue ${object + 1} of ${objects}` : "the tissue";
  const size = voxels > 0n ? `, ${voxels.toLocaleString("en")} voxels` : "";
  return `The server makes ${which}${size}: ${work}…`;
}
