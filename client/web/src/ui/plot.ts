// Force and depth of the tool in hand over the last seconds.

export interface PlotPoint {
  timeS: number;
  forceN: number;
  depthM: number;
}

const WINDOW_S = 8;
/** An axis reaches to this at least, N and m: less is rounding. */
const LEAST_FULL = 1e-3;
const MARGIN = { top: 10, bottom: 20 };
/** Clear of the labels of an axis, px. */
const BESIDE = 6;

interface Curve {
  color: string;
  value: (point: PlotPoint) => number;
  side: "left" | "right";
  /** Value at the upper end of its axis, and what is written at the lower end, the middle and the upper one. */
  full: number;
  labels: readonly string[];
}

export class Plot {
  private readonly canvas: HTMLCanvasElement;
  private points: PlotPoint[] = [];
  /** What it was drawn with, and whether there are other points since. */
  private drawnWith = "";
  private isStale = true;

  constructor(canvas: HTMLCanvasElement) {
    this.canvas = canvas;
  }

  add(points: readonly PlotPoint[]): void {
    const newest = points.at(-1);
    if (!newest) return;
    this.isStale = true;
    // Time that runs backwards is a reset, or a way back to a point.
    const last = this.points.at(-1);
    if (last && newest.timeS < last.timeS) this.points = [];
    this.points.push(...points);
    this.points = this.points.filter(({ timeS }) => timeS >= newest.timeS - WINDOW_S);
  }

  clear(): void {
    this.isStale = true;
    this.points = [];
  }

  /** Highest force that is shown, N. */
  get peakForceN(): number {
    return this.points.reduce((peak, { forceN }) => Math.max(peak, forceN), 0);
  }

  draw(): void {
    const { canvas } = this;
    const ratio = devicePixelRatio;
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    if (width === 0) return;
    const style = getComputedStyle(canvas);
    const color = (name: string) => style.getPropertyValue(name);
    const colors = { force: color("--force"), depth: color("--depth"), line: color("--line"), label: color("--muted") };
    const drawnWith = JSON.stringify([width, height, ratio, colors]);
    if (!this.isStale && drawnWith === this.drawnWith) return;
    this.isStale = false;
    this.drawnWith = drawnWith;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d")!;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = `11px ${style.fontFamily}`;
    const force = this.curveOf(colors.force, "left", "N", (point) => point.forceN);
    const depth = this.curveOf(colors.depth, "right", "m", (point) => point.depthM);
    // As much room beside the curves as the labels take.
    const room = ({ labels }: Curve) => Math.max(...labels.map((label) => context.measureText(label).width)) + 2 * BESIDE;
    const area = {
      x: room(force),
      y: MARGIN.top,
      width: width - room(force) - room(depth),
      height: height - MARGIN.top - MARGIN.bottom,
    };
    grid(context, area, colors.line, colors.label);
    this.curve(context, area, depth);
    this.curve(context, area, force);
  }

  private curveOf(color: string, side: Curve["side"], unit: string, value: Curve["value"]): Curve {
    const full = niceCeiling(this.points.reduce((most, point) => Math.max(most, value(point)), 0));
    return { color, side, value, full, labels: axisLabels(full, unit) };
  }

  private curve(context: CanvasRenderingContext2D, area: Area, curve: Curve): void {
    const { full } = curve;
    const values = this.points.map(curve.value);
    context.fillStyle = curve.color;
    context.textAlign = curve.side === "left" ? "right" : "left";
    const x = curve.side === "left" ? area.x - BESIDE : area.x + area.width + BESIDE;
    curve.labels.forEach((label, i) => context.fillText(label, x, area.y + area.height * (1 - i / 2) + 4));
    const now = this.points.at(-1)?.timeS ?? 0;
    context.strokeStyle = curve.color;
    context.lineWidth = 1.6;
    context.lineJoin = "round";
    context.beginPath();
    this.points.forEach(({ timeS }, i) => {
      const across = area.x + area.width * (1 - (now - timeS) / WINDOW_S);
      context.lineTo(across, area.y + area.height * (1 - Math.max(0, values[i]) / full));
    });
    context.stroke();
  }
}

interface Area {
  x: number;
  y: number;
  width: number;
  height: number;
}

function grid(context: CanvasRenderingContext2D, area: Area, line: string, text: string): void {
  context.strokeStyle = line;
  context.lineWidth = 1;
  context.beginPath();
  for (const share of [0, 0.5, 1]) {
    const y = Math.round(area.y + area.height * share) + 0.5;
    context.moveTo(area.x, y);
    context.lineTo(area.x + area.width, y);
  }
  context.stroke();
  context.fillStyle = text;
  context.textAlign = "left";
  context.fillText(`−${WINDOW_S} s`, area.x, area.y + area.height + 15);
  context.textAlign = "right";
  context.fillText("now", area.x + area.width, area.y + area.height + 15);
}

/** Numbers at the lower end, the middle and the upper end of an axis, the last with its unit. */
export function axisLabels(full: number, unit: string): readonly string[] {
  const [power, prefix] = full >= 1000 ? [1e3, "k"] : full >= 1 ? [1, ""] : [1e-3, "m"];
  return ["0", short(full / 2 / power), `${short(full / power)} ${prefix}${unit}`];
}

/** The next of 1, 2, 5, 10, ... times a power of ten that is not below the value. */
export function niceCeiling(value: number): number {
  const power = 10 ** Math.floor(Math.log10(Math.max(value, LEAST_FULL)));
  return [1, 2, 5, 10].map((factor) => factor * power).find((ceiling) => ceiling >= value * 0.999)!;
}

function short(value: number): string {
  return String(Number(value.toPrecision(2)));
}
