// The page's end of the worker that drives tools: the page says where they are wanted.

import type { Vector } from "./frames";
import { heldToken } from "./token";

export interface DrivenPose {
  position: Vector;
  orientation: readonly [number, number, number, number];
  /** Fraction of their full opening that the jaws take. */
  opening: number;
}

export type ToHandsWorker =
  | { kind: "open"; sessionId: string; sceneSizeM: number; token: string | undefined }
  /** Puts a tool down somewhere, through the air. */
  | { kind: "put"; toolId: number; goal: DrivenPose }
  /** Where a tool that was put down is wanted now. */
  | { kind: "want"; toolId: number; goal: DrivenPose }
  /** Takes a tool out of the scene. */
  | { kind: "lift"; toolId: number }
  /** Lifts every tool. */
  | { kind: "end" };

export type FromHandsWorker =
  | { kind: "roundTrip"; milliseconds: number }
  | { kind: "slipped" }
  /** A tool in hand is in tissue that it has not come into by moving: it touches nothing until it is clear. */
  | { kind: "waits" }
  | { kind: "refused"; toolId: number; why: string };

/** Tools of one session as they are driven. A page has one session, so it has one worker. */
export class Hands {
  private static readonly worker = new Worker(new URL("./hands-worker.ts", import.meta.url), {
    type: "module",
    name: "kerf-hands",
  });

  constructor(sessionId: string, sceneSizeM: number, hear: (message: FromHandsWorker) => void) {
    Hands.worker.onmessage = ({ data }: MessageEvent<FromHandsWorker>) => hear(data);
    this.tell({ kind: "open", sessionId, sceneSizeM, token: heldToken() });
  }

  tell(message: ToHandsWorker): void {
    Hands.worker.postMessage(message);
  }
}
