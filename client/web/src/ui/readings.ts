// What the instruments say: force and depth, what was cut, energies, and whether the machine keeps up.

import type { Energy, Frame } from "../net/frames";
import { byId, element, write } from "./dom";
import { digits, milliseconds, withUnit } from "./numbers";
import { Plot, type PlotPoint } from "./plot";

/** Time between two states that are written, ms: nobody reads faster. */
const WRITTEN_EVERY_MS = 200;

/** A line of a card: a name and a value that changes. */
function reading(name: string, tip = ""): { line: HTMLElement; value: HTMLElement } {
  const value = element("output", { textContent: "–", data: { reading: name } });
  const line = element("div", { className: "reading", title: tip }, element("span", { textContent: name }), value);
  return { line, value };
}

const ENERGIES: readonly (readonly [string, keyof Energy, string])[] = [
  ["Work of the tools", "toolWorkJ", "What the tools have put into the tissue"],
  ["Stored", "elasticJ", "Elastic energy that the tissue would give back"],
  ["Cutting", "fractureJ", "What the new surface has cost: fracture energy times its area"],
  ["Lost as heat", "dissipatedJ", "Damping, friction and the time step's own dissipation"],
  ["Error", "errorJ", "What the others leave unexplained: steps are not exact"],
];

export class Readings {
  private readonly plot: Plot;
  private readonly force = element("output", { className: "large force", textContent: "0 N" });
  private readonly depth = element("output", { className: "large depth", textContent: "0 mm" });
  private readonly cutArea = reading("Cut area", "At rest, counted once for its two walls");
  private readonly pieces = reading("Pieces", "Closed surfaces that nothing joins");
  private readonly energies = ENERGIES.map(([name, key, tip]) => ({ key, ...reading(name, tip) }));
  private readonly load = element("div", { className: "fill" });
  private readonly stepTime = reading("Step", "Mean time of a step, and the time that it has");
  private readonly late = reading("Late steps", "Share of the last seconds' steps that ended after their deadline");
  private readonly roundTripMs = reading("Round trip", "From sending a pose to its answer");
  private readonly simTime = reading("Time");
  private readonly before = element("p", { className: "before", hidden: true });
  private recentMs = 0;
  private tally: { step: number; lateSteps: number }[] = [];
  private felt: PlotPoint | undefined;
  /** Writes the newest state, if it is not written yet. */
  private unwritten: (() => void) | undefined;
  private isWaiting = false;

  constructor() {
    const canvas = element("canvas", {
      className: "plot",
      aria: { role: "img", label: "Force on the tool and its depth over the last seconds" },
    });
    this.plot = new Plot(canvas);
    const card = (title: string, ...lines: HTMLElement[]) =>
      element("section", { className: "panel" }, element("h2", { textContent: title }), ...lines);
    const meter = element("div", { className: "meter" }, this.load);
    byId("readings").replaceChildren(
      card("Force and depth", element("div", { className: "pair" }, this.force, this.depth), canvas),
      card("Cut", this.cutArea.line, this.pieces.line),
      card("Energy", ...this.energies.map(({ line }) => line)),
      card("Speed", this.stepTime.line, meter, this.late.line, this.roundTripMs.line, this.simTime.line, this.before),
    );
  }

  /** Another session. */
  clear(): void {
    this.plot.clear();
    this.unwritten = undefined;
    this.tally = [];
    this.recentMs = 0;
    this.roundTripMs.value.textContent = "–";
  }

  /** Force and depth of the tool that is looked at. */
  addPoints(points: readonly PlotPoint[]): void {
    this.plot.add(points);
    this.felt = points.at(-1) ?? this.felt;
  }

  showNothingFelt(): void {
    this.felt = undefined;
  }

  /** What a frame says; `dtS` is the time that a step has. */
  show(frame: Frame, dtS: number, cutAreaM2: number, pieces: number): void {
    if (frame.stepMeanS > 0) {
      // Smoothed, so that it can be read.
      this.recentMs += (this.recentMs === 0 ? 1 : 0.1) * (1000 * frame.stepMeanS - this.recentMs);
    }
    const latePercent = 100 * this.lateShare(frame);
    this.unwritten = () => this.write(frame, dtS, cutAreaM2, pieces, latePercent);
    if (!this.isWaiting) this.writeNewest();
  }

  private writeNewest(): void {
    this.unwritten?.();
    this.isWaiting = this.unwritten !== undefined;
    this.unwritten = undefined;
    if (this.isWaiting) setTimeout(() => this.writeNewest(), WRITTEN_EVERY_MS);
  }

  private write(frame: Frame, dtS: number, cutAreaM2: number, pieces: number, latePercent: number): void {
    write(this.force, withUnit(this.felt?.forceN ?? 0, "N"));
    write(this.depth, `${digits(1000 * (this.felt?.depthM ?? 0))} mm`);
    write(this.cutArea.value, `${digits(1e4 * cutAreaM2)} cm²`);
    write(this.pieces.value, String(pieces));
    for (const { key, value } of this.energies) write(value, frame.energy ? withUnit(frame.energy[key], "J") : "–");
    const load = this.recentMs / (1000 * dtS);
    write(this.stepTime.value, `${digits(this.recentMs)} of ${milliseconds(dtS)}`);
    this.load.style.width = `${Math.min(100, 100 * load).toFixed(0)}%`;
    this.load.className = load > 1 ? "fill over" : load > 0.8 ? "fill close" : "fill";
    write(this.late.value, `${digits(latePercent)} %`);
    write(this.simTime.value, `${frame.simTimeS.toFixed(1)} s`);
    this.simTime.value.title = `Step ${frame.step}`;
    this.plot.draw();
  }

  showRoundTrip(milliseconds: number): void {
    write(this.roundTripMs.value, `${digits(milliseconds)} ms`);
  }

  /** Keeps what a setting cost and did, to stand beside the next one. */
  keepForComparison(): void {
    const peak = withUnit(this.plot.peakForceN, "N");
    this.before.textContent = `Before the change: ${digits(this.recentMs)} ms a step, peak force ${peak}`;
    this.before.hidden = false;
  }

  private lateShare({ step, lateSteps }: Frame): number {
    const last = this.tally.at(-1);
    if (last && step < last.step) this.tally = [];
    this.tally.push({ step, lateSteps });
    if (this.tally.length > 120) this.tally.shift();
    const first = this.tally[0];
    return step > first.step ? (lateSteps - first.lateSteps) / (step - first.step) : 0;
  }
}
