// Reads the view stream, keeps the replica and makes arrays to draw, beside the page's own thread.
//
// Nothing is queued: a frame goes to the page when the page has drawn the one before, made of the newest state.

/// <reference lib="webworker" />
import { createClient } from "@connectrpc/connect";
import { createGrpcWebTransport } from "@connectrpc/connect-web";
import { Assembler } from "../decode/assembler";
import { ReplicaError } from "../decode/check";
import { Replica } from "../decode/replica";
import { shapeArrays, structureArrays, type SurfaceShape, type SurfaceStructure } from "../decode/surface";
import { Surfaces } from "../decode/surfaces";
import { EventKind } from "../gen/kerf/v1/types_pb";
import { type State, type ToolState, type ViewResponse, ViewService } from "../gen/kerf/v1/view_pb";
import { Acknowledger } from "./acknowledger";
import { inWords, isGone, movedTo } from "./errors";
import { energyOf } from "./energy";
import type { Frame, FromWorker, Sample, StreamStatus, ToolFrame, ToWorker, Wants } from "./frames";
import { sayToken, withToken } from "./token";

const FIRST_RETRY_MS = 250;
// A server that is started anew has its viewers back within two seconds.
const LAST_RETRY_MS = 1000;
/** Samples that wait for a page that does not draw (a tab in the background). */
const MAX_SAMPLES = 600;

const scope = self as unknown as DedicatedWorkerGlobalScope;

let viewing: Viewing | undefined;
let wants: Wants = { nodes: false, adaptation: true };

scope.onmessage = ({ data }: MessageEvent<ToWorker>) => {
  switch (data.kind) {
    case "open":
      viewing?.end();
      sayToken(data.token);
      viewing = new Viewing(data.sessionId, data.server);
      void viewing.run();
      break;
    case "close":
      viewing?.end();
      viewing = undefined;
      break;
    case "drawn":
      viewing?.drawn(data.shapes);
      break;
    case "want":
      wants = data.wants;
      viewing?.show();
  }
};

function post(message: FromWorker, transfer: Transferable[] = []): void {
  scope.postMessage(message, transfer);
}

/** One session, from when it is opened until another one is. */
class Viewing {
  private readonly stop = new AbortController();
  private readonly sessionId: string;
  private readonly server: string;
  private replica = new Replica();
  private readonly surfaces = new Surfaces();
  /** What is new of the structure since the last frame, by object. */
  private structures: (SurfaceStructure | undefined)[] = [];
  private state: State | undefined;
  /** That of the newest state: a patch that comes after it opens seams that are new then. */
  private simTimeS = 0;
  private samples: Sample[] = [];
  /** Arrays that the page has done with, by object. */
  private spare: (SurfaceShape | undefined)[] = [];
  private pageIsReady = true;

  constructor(sessionId: string, server: string) {
    this.sessionId = sessionId;
    this.server = server;
  }

  end(): void {
    this.stop.abort();
  }

  drawn(shapes: SurfaceShape[]): void {
    this.pageIsReady = true;
    this.spare = shapes;
    if (this.samples.length > 0) this.show();
  }

  /** Follows the session until it ends; a lost connection is made anew. */
  async run(): Promise<void> {
    let retryMs = FIRST_RETRY_MS;
    this.tell({ phase: "connecting" });
    while (!this.stop.signal.aborted) {
      try {
        await this.follow(() => (retryMs = FIRST_RETRY_MS));
        // The server ends a stream by itself only with its session.
        return this.tell({ phase: "ended", message: "The session was ended." });
      } catch (error) {
        if (this.stop.signal.aborted) return;
        const to = movedTo(error);
        if (to !== undefined) return this.tell({ phase: "moved", to });
        if (isGone(error)) return this.tell({ phase: "ended", message: inWords(error) });
        // What was missed comes with the keyframe that a new stream begins with.
        if (error instanceof ReplicaError) continue;
        this.tell({ phase: "lost", message: inWords(error) });
        await new Promise((resolve) => setTimeout(resolve, retryMs));
        retryMs = Math.min(2 * retryMs, LAST_RETRY_MS);
      }
    }
  }

  private async follow(begun: () => void): Promise<void> {
    const client = createClient(ViewService, createGrpcWebTransport({ baseUrl: this.server, interceptors: [withToken] }));
    const request = { protocolVersion: 3, sessionId: this.sessionId, wantsEnergy: true };
    const assembler = new Assembler();
    let acknowledger: Acknowledger | undefined;
    for await (const part of client.view(request, { signal: this.stop.signal })) {
      const whole = assembler.take(part);
      if (!whole) continue;
      const { message, number } = whole;
      if (message.case === "hello") acknowledger = new Acknowledger(client, message.value.viewer);
      if (message.case === "keyframe") {
        begun();
        this.tell({ phase: "live" });
      }
      this.take(message);
      acknowledger?.read(number);
      if (message.case === "event" && message.value.kind === EventKind.CLOSING) return;
    }
  }

  private take(message: ViewResponse["message"]): void {
    switch (message.case) {
      case "keyframe":
        this.replica.applyKeyframe(message.value);
        this.restructure();
        break;
      case "patch":
        this.replica.applyPatch(message.value);
        this.restructure(this.simTimeS);
        break;
      case "state":
        this.takeState(message.value);
        break;
      case "event": {
        const { kind, step, toolId, relativeTolerance, checkpointName, unsolvedSteps, pieceCount } = message.value;
        const event = { kind, step: Number(step), toolId, relativeTolerance, checkpointName, unsolvedSteps, pieceCount };
        post({ kind: "event", event });
        break;
      }
      case "fault":
        post({ kind: "fault", object: message.value.object, step: Number(message.value.step) });
    }
  }

  private restructure(nowS?: number): void {
    // New nodes have no place before the state that follows.
    this.state = undefined;
    this.surfaces.follow(this.replica.bodies, nowS).forEach((structure, index) => {
      if (structure) this.structures[index] = { ...this.structures[index], ...structure };
    });
  }

  private takeState(state: State): void {
    try {
      this.replica.applyState(state);
    } catch (error) {
      if (error instanceof ReplicaError && !error.needsKeyframe) return;
      throw error;
    }
    this.state = state;
    this.simTimeS = state.simTimeS;
    this.samples.push({ simTimeS: state.simTimeS, tools: state.tools.map(toolFrame) });
    if (this.samples.length > MAX_SAMPLES) this.samples.shift();
    this.show();
  }

  /** Sends the newest state to the page, if it waits for one. */
  show(): void {
    if (!this.pageIsReady || !this.state) return;
    this.pageIsReady = false;
    const bodies = this.surfaces.all.map((surface, index) => ({
      shape: surface.shape(this.spare[index], wants.adaptation),
      ...(this.structures[index] && { structure: this.structures[index] }),
      ...(wants.nodes && { nodes: surface.nodePositions() }),
    }));
    const arrays = bodies.flatMap(({ shape, structure, nodes }) => [
      ...shapeArrays(shape),
      ...(structure ? structureArrays(structure) : []),
      ...(nodes ? [nodes] : []),
    ]);
    const frame: Frame = { ...summary(this.state), samples: this.samples, bodies };
    post({ kind: "frame", frame }, arrays.map((array) => array.buffer));
    this.samples = [];
    this.structures = [];
    this.spare = [];
  }

  private tell(status: StreamStatus): void {
    post({ kind: "status", status });
  }
}

function toolFrame(tool: ToolState): ToolFrame {
  const { pose, wrench, cuttingLengthM, opening, isHolding } = tool;
  const force = wrench?.forceN;
  const position = pose?.positionM;
  const turn = pose?.orientation;
  return {
    ...(position && turn && {
      pose: { position: [position.x, position.y, position.z], orientation: [turn.x, turn.y, turn.z, turn.w] },
    }),
    forceN: force ? [force.x, force.y, force.z] : [0, 0, 0],
    cuttingLengthM,
    opening,
    isHolding,
  };
}

function summary(state: State): Omit<Frame, "samples" | "bodies"> {
  const { profile, energy } = state;
  return {
    step: Number(state.step),
    simTimeS: state.simTimeS,
    lateSteps: Number(state.lateSteps),
    stepMeanS: profile?.stepMeanS ?? 0,
    stepMaxS: profile?.stepMaxS ?? 0,
    stageMeansS: profile?.stageMeanS ?? [],
    ...(energy && { energy: energyOf(energy) }),
  };
}
