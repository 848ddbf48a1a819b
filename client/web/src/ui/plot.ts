// Force and depth of the tool in hand over the last seconds.

export interface PlotPoint {
  timeS: number;
  forceN: number;
  depthM: number;
}

const WINDOW_S = 8;
const MARGIN = { left: 40, right: 48, top: 10, bottom: 20 };

interface Curve {
  color: string;
  /** Value of a point in the unit of its axis. */
  value: (point: PlotPoint) => number;
  side: "left" | "right";
  unit: string;
}

export class Plot {
  private readonly canvas: HTMLCanvasElement;
  private points: PlotPoint[] = [];

  constructor(canvas: HTMLCanvasElement) {
    this.canvas = canvas;
  }

  add(points: readonly PlotPoint[]): void {
    const newest = points.at(-1);
    if (!newest) return;
    // Time that runs backwards is a reset, or a way back to a point.
    const last = this.points.at(-1);
    if (last && newest.timeS < last.timeS) this.points = [];
    this.points.push(...points);
    this.points = this.points.filter(({ timeS }) => timeS >= newest.timeS - WINDOW_S);
  }

  clear(): void {
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
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d")!;
    const style = getComputedStyle(canvas);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = `11px ${style.fontFamily}`;
    const area = {
      x: MARGIN.left,
      y: MARGIN.top,
      width: width - MARGIN.left - MARGIN.right,
      height: height - MARGIN.top - MARGIN.bottom,
    };
    const color = (name: string) => style.getPropertyValue(name);
    grid(context, area, color("--line"), color("--muted"));
    const force: Curve = { color: color("--force"), value: (p) => p.forceN, side: "left", unit: "N" };
    const depth: Curve = { color: color("--depth"), value: (p) => 1000 * p.depthM, side: "right", unit: "mm" };
    this.curve(context, area, depth);
    this.curve(context, area, force);
  }

  private curve(context: CanvasRenderingContext2D, area: Area, curve: Curve): void {
    const values = this.points.map(curve.value);
    const full = niceCeiling(values.reduce((most, value) => Math.max(most, value), 0));
    context.fillStyle = curve.color;
    context.textAlign = curve.side === "left" ? "right" : "left";
    const x = curve.side === "left" ? area.x - 6 : area.x + area.width + 6;
    for (const share of [0, 0.5, 1]) {
      const label = share === 1 ? `${short(full)} ${curve.unit}` : short(share * full);
      context.fillText(label, x, area.y + area.height * (1 - share) + 4);
    }
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

/** The next of 1, 2, 5, 10, ... that is not below the value. */
function niceCeiling(value: number): number {
  const power = 10 ** Math.floor(Math.log10(Math.max(value, 0.1)));
  return [1, 2, 5, 10].map((factor) => factor * power).find((ceiling) => ceiling >= value * 0.999)!;
}

function short(value: number): string {
  return String(Number(value.toPrecision(2)));
}
