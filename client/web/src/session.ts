// A session that is watched and worked on.

import type { SurfaceShape } from "./decode/surface";
import type { SessionDescription } from "./gen/kerf/v1/session_pb";
import { EventKind, SessionState } from "./gen/kerf/v1/types_pb";
import { Hand } from "./hand";
import { inWords } from "./net/errors";
import type { Frame, SessionEvent, StreamStatus } from "./net/frames";
import { Hands } from "./net/hands";
import type { FromHandsWorker } from "./net/hands-messages";
import { Interiors } from "./net/interiors";
import { sessions } from "./net/server";
import type { Stage } from "./scene/stage";
import type { Style } from "./scene/tissue";
import { SessionPicture } from "./session-picture";
import { Stroke } from "./stroke";
import { SHOWN_MS, say } from "./ui/messages";
import type { Readings } from "./ui/readings";

/** Words about late steps come at most this often, ms. */
const OVERLOAD_WORDS_MS = 20_000;

/** So many of something. */
function times(count: number, noun: string): string {
  return count === 1 ? `1 ${noun}` : `${count} ${noun}s`;
}

/** Who shows what a session is doing. */
export interface SessionListener {
  onStatus(status: StreamStatus): void;
  onPaused(isPaused: boolean): void;
  onFailed(why: string): void;
  /** Another tool is in hand, or none. */
  onTool(toolId: number | undefined): void;
}

export class Session {
  readonly id: string;
  readonly picture: SessionPicture;
  private readonly description: SessionDescription;
  private readonly readings: Readings;
  private readonly listener: SessionListener;
  private readonly driven: Hands;
  private readonly interiors: Interiors;
  private readonly hands = new Map<number, Hand>();
  private readonly stroke = new Stroke();
  private active: number | undefined;
  private paused: boolean;
  private overloadSaidMs = Number.NEGATIVE_INFINITY;
  private unsolved = { steps: 0, saidMs: Number.NEGATIVE_INFINITY };

  constructor(stage: Stage, description: SessionDescription, readings: Readings, listener: SessionListener) {
    this.id = description.sessionId;
    this.description = description;
    this.readings = readings;
    this.listener = listener;
    this.picture = new SessionPicture(stage, description.scene!);
    this.paused = description.state !== SessionState.RUNNING;
    this.driven = new Hands(this.id, this.picture.sizeM, (message) => this.hearHands(message));
    this.interiors = new Interiors(this.id, description.scene!.objects.length, {
      onInterior: (object, told) => this.picture.showInterior(object, told),
      onRefused: (error) => say(inWords(error), "problem"),
    });
    readings.clear();
    listener.onPaused(this.paused);
    if (description.state === SessionState.FAILED) listener.onFailed(description.failure);
  }

  get isPaused(): boolean {
    return this.paused;
  }

  set style(style: Style) {
    this.picture.style = style;
    if (style === "voxels" || style === "links") this.interiors.start();
    else this.interiors.stop();
  }

  /** The tool in hand. */
  get hand(): Hand | undefined {
    return this.active === undefined ? undefined : this.hands.get(this.active);
  }

  /** Takes a tool in hand, over the tissue if it is not in the scene yet; without one, none is in hand. */
  take(toolId: number | undefined): void {
    if (toolId !== undefined && toolId >= this.picture.tools.length) return;
    this.active = toolId;
    if (toolId !== undefined && !this.hands.has(toolId)) this.place(toolId);
    this.listener.onTool(toolId);
  }

  /** Takes the tool in hand out of the scene. */
  putAway(): void {
    if (this.active === undefined) return;
    this.driven.tell({ kind: "lift", toolId: this.active });
    this.letGo(this.active);
  }

  /** Puts the tool in hand down over a point of the canvas, if there is tissue. */
  placeAt(x: number, y: number): void {
    const point = this.picture.pick(x, y);
    if (point && this.active !== undefined) this.place(this.active, point);
  }

  /** To be called once a picture. */
  tick(): void {
    for (const [toolId, hand] of this.hands) {
      const goal = hand.moved();
      if (!goal) continue;
      this.driven.tell({ kind: "want", toolId, goal });
      this.picture.showHand(toolId, goal);
    }
  }

  /** Shows a frame; answers with arrays that are shown no more. */
  show(frame: Frame): SurfaceShape[] {
    const used = this.picture.show(frame);
    for (const [toolId, hand] of this.hands) this.picture.showHand(toolId, hand.goal);
    const shown = this.active ?? frame.samples.at(-1)?.tools.findIndex(({ pose }) => pose) ?? -1;
    // Without a tool in the scene nothing is felt.
    if (shown >= 0) this.readings.addPoints(this.stroke.points(frame.samples, shown));
    else this.readings.showNothingFelt();
    const dtS = this.description.scene?.dtS ?? 1;
    this.readings.show(frame, dtS, this.picture.cutAreaM2, this.picture.pieceCount);
    return used;
  }

  hearStatus(status: StreamStatus): void {
    this.listener.onStatus(status);
  }

  hear({ kind, toolId, checkpointName, relativeTolerance, unsolvedSteps, pieceCount }: SessionEvent): void {
    const toolName = () => this.picture.tools[toolId]?.name ?? "tool";
    switch (kind) {
      case EventKind.PAUSED:
      case EventKind.RESUMED:
        this.paused = kind === EventKind.PAUSED;
        return this.listener.onPaused(this.paused);
      case EventKind.RESET:
        return this.placeAll("The tissue is whole and at rest again.");
      case EventKind.CHECKPOINT_RESTORED:
        return this.placeAll(`Back at ${checkpointName}.`);
      case EventKind.CHECKPOINT_SAVED:
        return say(`Saved ${checkpointName}.`);
      case EventKind.CHECKPOINT_UPLOADED:
        return say(`${checkpointName} came as a file.`);
      case EventKind.TOOL_TAKEN:
        return this.hands.has(toolId) ? undefined : say(`Somebody has taken the ${toolName()}.`);
      case EventKind.TOOL_RELEASED:
        return this.hands.has(toolId) ? undefined : say(`The ${toolName()} is free.`);
      case EventKind.REANCHORED:
        return this.sayOverload();
      case EventKind.TOLERANCE_CHANGED:
        return say(`Forces are now computed to ${relativeTolerance.toExponential(0)}, to keep up.`, "note", "tolerance");
      case EventKind.UNSOLVED:
        return this.sayUnsolved(unsolvedSteps);
      case EventKind.PUT_AWAY:
        return say(`${times(pieceCount, "piece")} fell out of reach and stopped there.`);
      case EventKind.FAILED:
        void sessions.describeSession({ sessionId: this.id }).then(({ session }) => {
          this.listener.onFailed(session?.failure ?? "");
        });
    }
  }

  hearFault(object: string): void {
    say(`A step went wrong in the ${object}. It was taken back and the tools were lifted.`, "problem");
  }

  /** Something that is asked of the server; what it refuses is said. */
  async ask(call: () => Promise<unknown>): Promise<void> {
    try {
      await call();
    } catch (error) {
      say(inWords(error), "problem");
    }
  }

  togglePause(): Promise<void> {
    const request = { sessionId: this.id };
    return this.ask(() => (this.paused ? sessions.resumeSession(request) : sessions.pauseSession(request)));
  }

  /** One picture's worth of steps: a single one could not be seen. */
  step(): Promise<void> {
    const steps = Math.max(1, Math.round(1 / 60 / (this.description.scene?.dtS ?? 1)));
    return this.ask(() => sessions.stepSession({ sessionId: this.id, steps }));
  }

  reset(): Promise<void> {
    return this.ask(() => sessions.resetSession({ sessionId: this.id }));
  }

  /** Lets go of everything; the session goes on. */
  leave(): void {
    this.driven.tell({ kind: "end" });
    this.interiors.stop();
    this.picture.dispose();
  }

  private hearHands(message: FromHandsWorker): void {
    switch (message.kind) {
      case "roundTrip":
        return this.readings.showRoundTrip(message.milliseconds);
      case "slipped":
        return say("What the jaws held slipped out: it took more force than they have.");
      case "waits":
        return say("The tool is in tissue that it has not cut its way into: lift it clear of the tissue.", "problem");
      case "refused":
        this.letGo(message.toolId);
        say(message.why, "problem");
    }
  }

  private place(toolId: number, point?: Parameters<SessionPicture["placeOver"]>[1]): void {
    const { position, turn } = this.picture.placeOver(toolId, point);
    const hand = new Hand(toolId, this.picture.sizeM, position, turn);
    this.hands.set(toolId, hand);
    this.driven.tell({ kind: "put", toolId, goal: hand.goal });
  }

  /** The tissue is another: tools that were in it begin over it again. */
  private placeAll(why: string): void {
    for (const toolId of this.hands.keys()) this.place(toolId);
    this.readings.clear();
    say(why);
  }

  private letGo(toolId: number): void {
    this.hands.delete(toolId);
    this.picture.showHand(toolId, undefined);
    if (this.active === toolId) {
      this.active = undefined;
      this.listener.onTool(undefined);
    }
  }

  /** Counts on while the last count stands. */
  private sayUnsolved(steps: number): void {
    const now = performance.now();
    const stands = now - this.unsolved.saidMs <= SHOWN_MS;
    this.unsolved = { steps: steps + (stands ? this.unsolved.steps : 0), saidMs: now };
    say(`Forces may jump: ${times(this.unsolved.steps, "step")} ended before they had settled.`, "note", "unsolved");
  }

  private sayOverload(): void {
    const now = performance.now();
    if (now - this.overloadSaidMs < OVERLOAD_WORDS_MS) return;
    this.overloadSaidMs = now;
    const words = "The machine does not keep up, so the tissue moves slower than your hand.";
    say(`${words} Change the scene: fewer steps a second, or a higher level.`);
  }
}
