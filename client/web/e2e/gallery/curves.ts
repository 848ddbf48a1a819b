// Curves of force over depth, as a drawing that stands on a sheet.

export interface Curve {
  name: string;
  color: string;
  /** Depth in mm, force in N. */
  points: readonly (readonly [number, number])[];
}

const WIDTH = 1200;
const HEIGHT = 330;
const AREA = { left: 80, right: 20, top: 20, bottom: 50 };

export function curves(all: readonly Curve[]): string {
  const depthMm = ceiling(Math.max(...all.flatMap(({ points }) => points.map(([x]) => x))));
  const forceN = ceiling(Math.max(...all.flatMap(({ points }) => points.map(([, y]) => y))));
  const x = (depth: number) => AREA.left + (depth / depthMm) * (WIDTH - AREA.left - AREA.right);
  const y = (force: number) => HEIGHT - AREA.bottom - (force / forceN) * (HEIGHT - AREA.top - AREA.bottom);
  const shares = [0, 0.2, 0.4, 0.6, 0.8, 1];
  const text = (at: string, words: string, fill = "#98a2b0") => `<text ${at} fill="${fill}">${words}</text>`;
  const grid = shares.flatMap((share) => [
    `<path d="M${AREA.left} ${y(share * forceN)}H${WIDTH - AREA.right}" stroke="#2b323c"/>`,
    text(`x="${AREA.left - 10}" y="${y(share * forceN) + 5}" text-anchor="end"`, number(share * forceN)),
    text(`x="${x(share * depthMm)}" y="${HEIGHT - 26}" text-anchor="middle"`, number(share * depthMm)),
  ]);
  const lines = all.flatMap(({ name, color, points }, i) => [
    `<path d="M${points.map(([depth, force]) => `${x(depth).toFixed(1)} ${y(force).toFixed(1)}`).join("L")}" fill="none" stroke="${color}" stroke-width="2.5"/>`,
    text(`x="${AREA.left + 16}" y="${AREA.top + 20 + 24 * i}" font-weight="600"`, name, color),
  ]);
  const axes = [
    text(`x="${WIDTH - AREA.right}" y="${HEIGHT - 4}" text-anchor="end"`, "depth of the edge below the top, mm"),
    text(`transform="translate(18 ${AREA.top + 4}) rotate(-90)" text-anchor="end"`, "force on the blade, N"),
  ];
  return `<svg viewBox="0 0 ${WIDTH} ${HEIGHT}" font-size="16">${[...grid, ...lines, ...axes].join("")}</svg>`;
}

/** The next of 1, 1.5, 2, 3, 4, 5, 8, 10, ... that is not below the value. */
function ceiling(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 1.5, 2, 3, 4, 5, 8, 10].map((factor) => factor * power).find((round) => round >= 0.999 * value)!;
}

function number(value: number): string {
  return String(Number(value.toPrecision(3)));
}
