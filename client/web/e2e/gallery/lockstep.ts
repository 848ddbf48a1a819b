// Tools that are driven step by step. The session waits for its client, so the same strokes lead to the same state,
// bit for bit, however slow the machine draws.

import { Quaternion, Vector3 } from "three";
import { parse, stringify, type TomlTable } from "smol-toml";
import type { SessionDescription, StepOutcome } from "../../src/gen/kerf/v1/session_pb";
import type { Server } from "../harness";

/** Steps of one call: a stroke ends within so many of where it is to end. */
const STEPS_A_CALL = 8;

/** Where a tool is to be. */
export interface Place {
  at: readonly [number, number, number];
  turn?: Quaternion;
  /** Of jaws: 1 is open. */
  opening?: number;
}

/** A tool moved evenly to a place in so many seconds, or lifted. */
export interface Leg {
  tool: string;
  to: Place | "lift";
  seconds?: number;
}

export type Scene = ({ name: string } | { text: string }) & {
  stepRateHz?: number;
  /** What is other than in the built-in scene, or the text. */
  change?: (scene: TomlTable) => void;
};

/** What is felt after a step. */
export interface Felt {
  simTimeS: number;
  /** Of the tool that moves. */
  forceN: number;
  /** Distance that the tool has gone on this leg, m. */
  goneM: number;
}

/** A turn about an axis, in degrees. */
export function turned(axis: readonly [number, number, number], degrees: number): Quaternion {
  return new Quaternion().setFromAxisAngle(new Vector3(...axis).normalize(), (degrees * Math.PI) / 180);
}

/** An edge that points away from whoever looks, so that a cut opens to both sides. */
export const ACROSS = turned([0, 1, 0], 90);

/** Halfway between two places of a tool that does not turn. */
export function middle(from: Place, to: Place): Place {
  return { ...from, at: new Vector3(...from.at).lerp(new Vector3(...to.at), 0.5).toArray() };
}

/** A session that takes steps when it is told to. */
export class LockStep {
  readonly sessionId: string;
  private readonly server: Server;
  private readonly tools: string[];
  private readonly dtS: number;
  private readonly places = new Map<string, { at: Vector3; turn: Quaternion; opening: number }>();
  /** The last step that was taken. */
  step = 0;

  private constructor(server: Server, { sessionId, scene }: SessionDescription) {
    this.server = server;
    this.sessionId = sessionId;
    this.tools = scene!.tools.map(({ name }) => name);
    this.dtS = scene!.dtS;
  }

  static async begin(server: Server, source: Scene): Promise<LockStep> {
    const { stepRateHz, change } = source;
    const scene = parse("text" in source ? source.text : await server.textOf(source.name));
    change?.(scene);
    const { session } = await server.sessions.createSession({
      scene: { case: "sceneToml", value: stringify(scene) },
      startPaused: true,
      ...(stepRateHz && { stepRateHz }),
    });
    return new LockStep(server, session!);
  }

  /** Takes the leg, or as much of it as it takes until something holds; answers with what was felt on the way. */
  async go({ tool, to, seconds = 0 }: Leg, until: (felt: Felt) => boolean = () => false): Promise<Felt[]> {
    const toolId = this.tools.indexOf(tool);
    if (to === "lift") {
      this.places.delete(tool);
      await this.take([{ motions: [{ motion: { case: "lift", value: { toolId } } }] }]);
      return [];
    }
    const end = { at: new Vector3(...to.at), turn: to.turn ?? new Quaternion(), opening: to.opening ?? 1 };
    // A tool that is not there yet enters where it is to be.
    const start = this.places.get(tool) ?? end;
    const steps = Math.max(1, Math.round(seconds / this.dtS));
    const felt: Felt[] = [];
    for (let done = 0; done < steps; ) {
      const count = Math.min(STEPS_A_CALL, steps - done);
      const places = Array.from({ length: count }, (_, i) => between(start, end, (done + i + 1) / steps));
      const outcomes = await this.take(places.map((place) => ({ motions: [motion(toolId, place)] })));
      outcomes.forEach((outcome, i) => felt.push(feel(outcome, toolId, places[i].at.distanceTo(start.at))));
      this.places.set(tool, places[count - 1]);
      done += count;
      if (felt.slice(-count).some(until)) break;
    }
    return felt;
  }

  /** Back to rest, without tools. */
  async reset(): Promise<void> {
    this.places.clear();
    await this.server.sessions.resetSession({ sessionId: this.sessionId });
  }

  /** Lets time pass. */
  async wait(seconds: number): Promise<void> {
    for (let left = Math.round(seconds / this.dtS); left > 0; left -= STEPS_A_CALL) {
      await this.take([], Math.min(left, STEPS_A_CALL));
    }
  }

  end(): Promise<unknown> {
    return this.server.sessions.closeSession({ sessionId: this.sessionId });
  }

  private async take(inputs: { motions: ToolMotion[] }[], steps = inputs.length): Promise<StepOutcome[]> {
    const taken = await this.server.sessions.stepSession({ sessionId: this.sessionId, steps, inputs });
    this.step = Number(taken.step);
    return taken.outcomes;
  }
}

type Held = { at: Vector3; turn: Quaternion; opening: number };
type ToolMotion = ReturnType<typeof motion> | { motion: { case: "lift"; value: { toolId: number } } };

function between(from: Held, to: Held, share: number): Held {
  return {
    at: from.at.clone().lerp(to.at, share),
    turn: from.turn.clone().slerp(to.turn, share),
    opening: from.opening + share * (to.opening - from.opening),
  };
}

function motion(toolId: number, { at, turn, opening }: Held) {
  const positionM = { x: at.x, y: at.y, z: at.z };
  const orientation = { x: turn.x, y: turn.y, z: turn.z, w: turn.w };
  return { motion: { case: "pose" as const, value: { toolId, pose: { positionM, orientation }, opening } } };
}

function feel({ simTimeS, contacts }: StepOutcome, toolId: number, goneM: number): Felt {
  const { x = 0, y = 0, z = 0 } = contacts[toolId].wrench?.forceN ?? {};
  return { simTimeS, forceN: Math.hypot(x, y, z), goneM };
}
