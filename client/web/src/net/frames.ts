// What passes between the page and its worker, which reads the stream, decodes it and makes arrays to draw.

import type { EventKind } from "../gen/kerf/v1/types_pb";
import type { SurfaceShape, SurfaceStructure } from "../decode/surface";

export type Vector = readonly [number, number, number];

/** A tool as the server has it. */
export interface ToolFrame {
  /** Absent while the tool is lifted. */
  pose?: { position: Vector; orientation: readonly [number, number, number, number] };
  forceN: Vector;
  cuttingLengthM: number;
  /** Fraction of their full opening that its jaws take. */
  opening: number;
  isHolding: boolean;
}

/** Energies since the scene was at rest, J. */
export interface Energy {
  toolWorkJ: number;
  elasticJ: number;
  fractureJ: number;
  /** Never below 0. */
  dissipatedJ: number;
  /** What the others leave unexplained, either way. */
  errorJ: number;
}

/** What a state says of every tool, for plots: none is left out when the page is slower than the stream. */
export interface Sample {
  simTimeS: number;
  tools: ToolFrame[];
}

export interface BodyFrame {
  shape: SurfaceShape;
  /** Present when the structure has changed since the last frame. */
  structure?: SurfaceStructure;
  /** Positions of the nodes, when they were asked for. */
  nodes?: Float32Array<ArrayBuffer>;
}

/** Everything that a picture needs. */
export interface Frame {
  step: number;
  simTimeS: number;
  lateSteps: number;
  stepMeanS: number;
  stepMaxS: number;
  stageMeansS: number[];
  energy?: Energy;
  samples: Sample[];
  bodies: BodyFrame[];
}

/** What a way of drawing needs of frames. */
export interface Wants {
  /** The nodes of the elements. */
  nodes: boolean;
  /** The surface put on the blade that dents or cuts it, and not only where the elements have it. */
  adaptation: boolean;
}

/** How the stream is doing. */
export type StreamStatus =
  | { phase: "connecting" }
  | { phase: "live" }
  /** Lost, and tried again. */
  | { phase: "lost"; message: string }
  /** The session goes on at this address. */
  | { phase: "moved"; to: string }
  /** The session is no more: the server says so, or says that it never had it. */
  | { phase: "ended"; message: string };

/** Something happened to the session. */
export interface SessionEvent {
  kind: EventKind;
  step: number;
  toolId: number;
  relativeTolerance: number;
  checkpointName: string;
  /** Steps that fell short. */
  unsolvedSteps: number;
  /** Pieces that were put away. */
  pieceCount: number;
}

export type FromWorker =
  | { kind: "frame"; frame: Frame }
  | { kind: "status"; status: StreamStatus }
  | { kind: "event"; event: SessionEvent }
  | { kind: "fault"; object: string; step: number };

export type ToWorker =
  | { kind: "open"; sessionId: string; server: string; token: string | undefined }
  | { kind: "close" }
  /** The frame was drawn; its predecessor's arrays come back to be filled again. */
  | { kind: "drawn"; shapes: SurfaceShape[] }
  | { kind: "want"; wants: Wants };
