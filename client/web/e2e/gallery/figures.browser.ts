// Makes the figures of the paper: sessions in lock-step, looked at through the viewer.

import { writeFile } from "node:fs/promises";
import type { TomlTable } from "smol-toml";
import { afterAll, test } from "vitest";
import { browser, server, useBrowserAndServer } from "../harness";
import { curves } from "./curves";
import { ACROSS, type Leg, LockStep, middle, type Place, type Scene, turned } from "./lockstep";
import { MODELS } from "./models";
import { type Look, type Panel, Window, writeSheet } from "./sheet";
import { galleryText } from "./text";

const DOCS = "../../docs/explanation";
/** Without a graphics card a picture takes seconds. */
const PATIENCE_MS = 1_200_000;

useBrowserAndServer();

afterAll(() => writeFile(`${DOCS}/gallery.md`, galleryText()));

/** A session with a window on it. */
async function watched(scene: Scene, look: Look) {
  const session = await LockStep.begin(server, scene);
  const window = await Window.open(browser, server.address, session, look);
  const end = async () => {
    await window.close();
    await session.end();
  };
  return { session, window, end };
}

const objects = (scene: TomlTable) => scene["objects"] as TomlTable[];
const regions = (scene: TomlTable) => objects(scene)[0]["regions"] as TomlTable[];
const mm = (metres: number) => `${(1000 * metres).toFixed(1)} mm`;

/** A block of elements of a level, drawn apart by the ends of an axis, so that a cut across it stands open. */
function drawApart(scene: TomlTable, level: number, axis: "x" | "z", tractionPa: number): void {
  const [block] = objects(scene);
  block["level"] = level;
  const region = { box: { min_m: [-1, -1, -1], max_m: [1, 1, 1] } };
  const pull = (end: "min" | "max", traction_pa: number) => ({
    traction: { region, face: `${end}_${axis}`, traction_pa: axis === "x" ? [traction_pa, 0, 0] : [0, 0, traction_pa] },
  });
  block["loads"] = [pull("min", -tractionPa), pull("max", tractionPa)];
}

/** How far a tool goes on a leg before the tissue gives, m: the force on it falls by a tenth. */
async function givesM(scene: Scene, first: Leg, leg: Leg): Promise<number> {
  const session = await LockStep.begin(server, scene);
  await session.go(first);
  let peak = { forceN: 0, goneM: 0 };
  await session.go(leg, (felt) => {
    if (felt.forceN > peak.forceN) peak = felt;
    return felt.forceN < 0.9 * peak.forceN;
  });
  await session.end();
  return peak.goneM;
}

/** A tool begins this far over the top, m: it enters the scene touching nothing. */
const AIR_M = 1e-4;
const slow = { timeout: PATIENCE_MS };

test("Fig. 2: a liver and what it is made of", slow, async () => {
  const look = { eye: [0.09, 0.2, 0.41], at: [0.005, 0.083, 0] } as const;
  const { session, window, end } = await watched({ name: "liver" }, look);
  await session.wait(0.02);
  const panels = [
    { picture: await window.shoot(), label: "surface" },
    { picture: await window.shoot("elements"), label: "composite elements within it" },
    { picture: await window.shoot("voxels"), label: "voxels, and the edges of the composite elements" },
  ];
  await writeSheet(browser, `${DOCS}/gallery-fig2.jpg`, [{ panels }]);
  await end();
});

test("Fig. 4: energy while a cuboid is cut", slow, async () => {
  const scene = { name: "cuboid", stepRateHz: 250, change: (toml: TomlTable) => drawApart(toml, 1, "x", 3e4) };
  const place = (y: number) => ({ tool: "blade", to: { at: [0, y, 0.04], turn: ACROSS } }) as const;
  const deepM = (await givesM(scene, place(0.07 + AIR_M), { ...place(0.06), seconds: 0.2 })) - AIR_M;
  const { session, window, end } = await watched(scene, { eye: [0.11, 0.16, 0.29], at: [0, 0.045, 0.01] });
  const rows: Panel[][] = [[], []];
  const shoot = async (label: string) => {
    rows[0].push({ picture: await window.shoot(), label });
    rows[1].push({ picture: await window.shoot("voxels"), label: "" });
  };
  // Once before, so that red stands for the same energy in every picture: the most, which is there before it gives.
  await session.go(place(0.07 + AIR_M));
  await session.go({ ...place(0.07 - 0.97 * deepM), seconds: 0.2 });
  await window.shoot("voxels");
  await session.reset();
  await session.go(place(0.07 + AIR_M));
  await session.go({ ...place(0.07 - 0.5 * deepM), seconds: 0.1 });
  await shoot(`edge ${mm(0.5 * deepM)} down`);
  await session.go({ ...place(0.07 - 0.97 * deepM), seconds: 0.1 });
  await shoot(`${mm(0.97 * deepM)} down, just before it gives`);
  await session.go({ ...place(0.05), seconds: 0.2 });
  await shoot("20 mm down");
  await session.go({ ...place(0.03), seconds: 0.2 });
  await shoot("40 mm down");
  const energies = `Elastic energy of each element: none is blue, ${await window.legend()} is red`;
  const titles = ["From dent to cut", energies];
  await writeSheet(browser, `${DOCS}/gallery-fig4.jpg`, rows.map((panels, i) => ({ title: titles[i], panels })));
  await end();
});

test("Fig. 9: with and without fracture and adaptation", slow, async () => {
  const place = (y: number) => ({ tool: "blade", to: { at: [0, y, 0.006], turn: ACROSS } }) as const;
  const brittle = (toml: TomlTable) => ((objects(toml)[0]["material"] as TomlTable)["fracture_energy_j_per_m2"] = 1);
  const run = async (styles: string[], change?: (toml: TomlTable) => void) => {
    const scene = { name: "jelly", stepRateHz: 500, ...(change && { change }) };
    const { session, window, end } = await watched(scene, { eye: [0.09, 0.125, 0.22], at: [0, 0.03, 0] });
    const near = await Window.open(browser, server.address, session, { eye: [0.06, 0.1, 0.1], at: [0, 0.042, 0.012] });
    await window.hideForces();
    await near.hideForces();
    const rows: Panel[][] = styles.map(() => []);
    const shoot = async (from: Window, label: string) => {
      for (const [i, style] of styles.entries()) rows[i].push({ picture: await from.shoot(style), label });
    };
    await session.go(place(0.055 + AIR_M));
    await session.go({ ...place(0.048), seconds: 0.14 });
    await shoot(window, "edge 7 mm down");
    await session.go({ ...place(0.041), seconds: 0.14 });
    await shoot(window, "14 mm");
    await session.go({ ...place(0.03), seconds: 0.22 });
    await shoot(window, "25 mm");
    await shoot(near, "25 mm, closer");
    await near.close();
    await end();
    return rows;
  };
  const [basic] = await run(["unadapted"], brittle);
  const [bare, whole] = await run(["unadapted", "tissue"]);
  await writeSheet(browser, `${DOCS}/gallery-fig9.jpg`, [
    { title: "Whatever the blade meets is cut (Gc of 1 J/m²)", panels: basic },
    { title: "The cut waits for its energy (Gc of 5000 J/m²); the surface is not adapted to the blade", panels: bare },
    { title: "The cut waits for its energy, and the surface lies on the blade", panels: whole },
  ]);
});

test("Fig. 12: three materials", slow, async () => {
  const place = (y: number) => ({ tool: "blade", to: { at: [0, y, 0.006], turn: ACROSS } }) as const;
  const colors: Record<string, string> = { jelly: "#e39a2f", tofu: "#e9e2d0", rubber: "#7cb8ff" };
  const rows = [];
  const drawn = [];
  for (const name of ["jelly", "tofu", "rubber"]) {
    const scene = { name, stepRateHz: 500 };
    const first = place(0.055 + AIR_M);
    const leg = { ...place(0.025), seconds: 0.6 };
    const deepM = (await givesM(scene, first, leg)) - AIR_M;
    const { session, window, end } = await watched(scene, { eye: [0.09, 0.125, 0.22], at: [0, 0.03, 0] });
    const panels: Panel[] = [];
    const points: [number, number][] = [];
    await session.go(first);
    let goneM = -AIR_M;
    const to = async (depthM: number, label: string) => {
      const felt = await session.go({ ...place(0.055 - depthM), seconds: (0.6 * (depthM - goneM)) / 0.03 });
      points.push(...felt.map((one) => [1000 * (goneM + one.goneM), one.forceN] as [number, number]));
      goneM = depthM;
      panels.push({ picture: await window.shoot(), label: `${label}: ${mm(depthM)}, ${points.at(-1)![1].toFixed(0)} N` });
    };
    await to(0.5 * deepM, "halfway");
    await to(0.97 * deepM, "just before it gives");
    await to(deepM + 0.5 * (0.03 - deepM), "cut");
    await to(0.03, "cut");
    await end();
    rows.push({ title: `${name[0].toUpperCase()}${name.slice(1)}`, panels });
    drawn.push({ name, color: colors[name], points });
  }
  await writeSheet(browser, `${DOCS}/gallery-fig12.jpg`, rows, curves(drawn));
});

test("Fig. 13: blades of other shapes", slow, async () => {
  const rows = [];
  for (const [name, title] of [["cuboid-polyline", "An edge of folds"], ["cuboid-sine", "An edge of waves"]]) {
    const scene = { name, stepRateHz: 250, change: (toml: TomlTable) => drawApart(toml, 2, "z", 5e4) };
    const place = (y: number) => ({ tool: "blade", to: { at: [0, y, 0.015] } }) as const;
    const leg = { ...place(0.03), seconds: 0.8 };
    const deepM = (await givesM(scene, place(0.07 + AIR_M), leg)) - AIR_M;
    const { session, window, end } = await watched(scene, { eye: [0.13, 0.2, 0.33], at: [0, 0.048, 0] });
    const near = await Window.open(browser, server.address, session, { eye: [0.045, 0.17, 0.17], at: [0, 0.062, 0.015] });
    await near.hideForces();
    const sides: Panel[] = [];
    const tops: Panel[] = [];
    await session.go(place(0.07 + AIR_M));
    let goneM = -AIR_M;
    const to = async (depthM: number, label: string) => {
      await session.go({ ...place(0.07 - depthM), seconds: (depthM - goneM) / 0.05 });
      goneM = depthM;
      sides.push({ picture: await window.shoot(), label });
      tops.push({ picture: await near.shoot(), label: "" });
    };
    await to(0.5 * deepM, `edge ${mm(0.5 * deepM)} down`);
    await to(0.97 * deepM, `${mm(0.97 * deepM)} down, just before it gives`);
    await to(0.035, "35 mm down");
    await session.go({ tool: "blade", to: "lift" });
    await session.wait(0.1);
    sides.push({ picture: await window.shoot(), label: "without the blade" });
    tops.push({ picture: await near.shoot(), label: "" });
    await near.close();
    await end();
    rows.push({ title, panels: sides }, { panels: tops });
  }
  await writeSheet(browser, `${DOCS}/gallery-fig13.jpg`, rows);
});

test("Fig. 14: a hepatectomy", slow, async () => {
  const turn = turned([0, 1, 0], 48);
  const grasper = (x: number, z: number, opening: number) =>
    ({ tool: "grasper", to: { at: [x, 0.1435, z], turn, opening } }) as const;
  const blade = (y: number) => ({ tool: "blade", to: { at: [0.063, y, 0.0329], turn } }) as const;
  const look = { eye: [0.15, 0.27, 0.4], at: [0.025, 0.105, 0.01] } as const;
  // The scene's lesion lies within the lobe; here it comes to the surface, where it can be seen.
  const change = (toml: TomlTable) => (regions(toml)[0]["shape"] = { sphere: { center_m: [0.075, 0.158, 0.057], radius_m: 0.014 } });
  const { session, window, end } = await watched({ name: "hepatectomy", stepRateHz: 500, change }, look);
  const panels: Panel[] = [];
  const shoot = async (label: string) => panels.push({ picture: await window.shoot(), label });
  await session.go(grasper(0.0919, 0.0589, 1));
  await session.go({ ...grasper(0.0919, 0.0589, 0), seconds: 0.05 });
  await session.go({ ...grasper(0.0956, 0.0622, 0), seconds: 0.2 });
  await session.go(blade(0.175));
  await session.go({ ...blade(0.1625), seconds: 0.1 });
  await shoot("held taut, and pressed");
  await session.go({ ...blade(0.135), seconds: 0.22 });
  await shoot("half through");
  await session.go({ ...blade(0.05), seconds: 0.68 });
  await session.go({ tool: "blade", to: "lift" });
  await session.go({ ...grasper(0.1142, 0.079, 0), seconds: 0.4 });
  await shoot("taken away, with the lesion");
  await writeSheet(browser, `${DOCS}/gallery-fig14.jpg`, [{ panels }]);
  await end();
});

test("Fig. 15: other models, cut at will", slow, async () => {
  const panels: Panel[][] = [[], []];
  for (const { scene, look, grasp, pull, cut, label } of MODELS) {
    const { session, window, end } = await watched(scene, look);
    const holds = (at: Place["at"], opening: number) => ({ tool: "grasper", to: { at, opening } }) as const;
    await session.go(holds(grasp, 1));
    await session.go({ ...holds(grasp, 0), seconds: 0.05 });
    await session.go({ tool: "blade", to: cut.from });
    await session.go({ tool: "blade", to: middle(cut.from, cut.to), seconds: 0.3 });
    panels[0].push({ picture: await window.shoot(), label });
    await session.go({ tool: "blade", to: cut.to, seconds: 0.3 });
    await session.go({ tool: "blade", to: "lift" });
    await session.go({ ...holds(pull, 0), seconds: 0.2 });
    await session.wait(0.1);
    panels[1].push({ picture: await window.shoot(), label: "" });
    await end();
  }
  await writeSheet(browser, `${DOCS}/gallery-fig15.jpg`, panels.map((row) => ({ panels: row })));
});
