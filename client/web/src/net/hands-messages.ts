// What the page and the worker that drives tools tell each other.

import type { Vector } from "./frames";

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
