// The viewer in a real browser, against a real server.

import { mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fromBinary } from "@bufbuild/protobuf";
import type { Page } from "playwright-core";
import { Vector3 } from "three";
import { afterEach, expect, test } from "vitest";
import { SendPoseRequestSchema } from "../src/gen/kerf/v1/control_pb";
import { SceneText } from "../src/scene-text";
import { ACROSS, LockStep } from "./gallery/lockstep";
import {
  APPLE,
  BAR,
  browser,
  darkenedShare,
  freePort,
  joules,
  live,
  open,
  paleShare,
  reading,
  readingWhere,
  redShare,
  Server,
  server,
  slowLink,
  seenBy,
  startSecured,
  useBrowserAndServer,
} from "./harness";

useBrowserAndServer();

// A page that is left open goes on drawing, which slows the others down; of sessions a server runs only so many.
afterEach(async () => {
  await Promise.all(browser.contexts().map((context) => context.close()));
  const { sessions } = await server.sessions.listSessions({});
  await Promise.all(sessions.map(({ sessionId }) => server.sessions.closeSession({ sessionId })));
});

test("a scene is chosen, begins and is seen", async () => {
  const { page, problems } = await open(browser, server.address);
  await page.click('[data-scene="tofu"]');
  await live(page);
  await readingWhere(page, "Time", (timeS) => timeS > 0.1);
  expect(new URL(page.url()).searchParams.get("session")).toBeTruthy();
  expect(await reading(page, "Pieces")).toBe(1);
  expect(problems).toEqual([]);
  const { sessions } = await server.sessions.listSessions({});
  await server.sessions.closeSession({ sessionId: sessions[0].sessionId });
  await page.waitForSelector("text=This session is over");
});

test("a scene of one's own is sent with its mesh, and how far it is is seen", async () => {
  const { page, problems } = await open(browser, server.address);
  const toml = BAR.replace(/shape = \{ box = .*/, 'shape = { mesh = { file = "meshes/bar.obj", scale_m_per_unit = 0.01 } }');
  const corners = "v -3 0 -1\nv 3 0 -1\nv 3 2 -1\nv -3 2 -1\nv -3 0 1\nv 3 0 1\nv 3 2 1\nv -3 2 1\n";
  const mesh = `${corners}f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 4 1 5 8\n`;
  const file = (name: string, text: string) => ({ name, mimeType: "text/plain", buffer: Buffer.from(text) });
  const chosen = page.locator("input[type=file]");
  await chosen.setInputFiles([file("mine.toml", toml)]);
  await page.waitForSelector("text=The scene refers to bar.obj");
  // What the page says of the way there, of more than one message's size.
  await page.evaluate(() => {
    const said: string[] = [];
    Object.assign(window, { said });
    const bar = document.querySelector("progress")!;
    new MutationObserver(() => said.push(bar.hidden ? "hidden" : bar.value.toFixed(2))).observe(bar, { attributes: true });
  });
  const long = mesh + "# a remark of some length\n".repeat(40_000);
  await chosen.setInputFiles([file("mine.toml", toml), file("bar.obj", long)]);
  await live(page);
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  const said = await page.evaluate(() => (window as unknown as { said: string[] }).said);
  const values = said.filter((word) => word !== "hidden").map(Number);
  expect(values.length).toBeGreaterThan(3);
  expect(values).toEqual([...values].sort((a, b) => a - b));
  expect(values.at(-1)).toBe(1);
  expect(problems).toEqual([]);
});

/** Rows of the plot that the curve of the force goes through: a few while there is none. */
function forceRows(page: Page): Promise<number> {
  return page.evaluate(() => {
    const canvas = document.querySelector<HTMLCanvasElement>("canvas.plot")!;
    const { width, height } = canvas;
    const { data } = canvas.getContext("2d")!.getImageData(0, 0, width, height);
    const rows = new Set<number>();
    for (let y = 0; y < height; y++) {
      // Beside the numbers of the axes.
      for (let x = Math.round(0.2 * width); x < 0.8 * width; x++) {
        const [r, g, b] = data.subarray(4 * (y * width + x));
        if (r > 200 && g > 120 && g < 210 && b < 140) rows.add(y);
      }
    }
    return rows.size;
  });
}

test("the mouse cuts a bar in two, and who comes late sees it cut", async () => {
  const sessionId = await server.create(BAR);
  const link = `${server.address}/?session=${sessionId}`;
  const { page, problems } = await open(browser, link);
  await live(page);
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  expect(await redShare(page)).toBeGreaterThan(0.02);
  await page.click("button:has-text('Blade')");
  // Down through the bar, until it is through.
  const canvas = page.locator("#stage");
  const box = (await canvas.boundingBox())!;
  const at = { x: box.x + 0.4 * box.width, y: box.y + 0.3 * box.height };
  await page.mouse.move(at.x, at.y);
  await page.mouse.down();
  expect(await forceRows(page)).toBeLessThan(6);
  let peakN = 0;
  for (let i = 1; i <= 60 && (await reading(page, "Pieces")) < 2; i++) {
    await page.mouse.move(at.x, at.y + 5 * i);
    await page.waitForTimeout(60);
    const text = (await page.textContent("output.force")) ?? "0";
    peakN = Math.max(peakN, Number.parseFloat(text) * (text.includes("mN") ? 1e-3 : 1));
  }
  await page.mouse.up();
  await readingWhere(page, "Pieces", (pieces) => pieces === 2);
  expect(peakN).toBeGreaterThan(0);
  // The newest fifth of the curve is beside what is looked at, and the axis may end at two and a half times the peak.
  expect(await forceRows(page)).toBeGreaterThan(10);
  // The bar's section is 20 mm x 20 mm.
  const areaCm2 = await reading(page, "Cut area");
  expect(areaCm2).toBeGreaterThan(2.5);
  expect(areaCm2).toBeLessThan(6);
  // What is taken along of it is two closed bodies.
  const saving = page.waitForEvent("download");
  await page.click("button[aria-label='Save the surface as GLB']");
  const file = await readFile(await (await saving).path());
  expect(edgesThatAreOpen(file)).toEqual([0, 0]);
  const { meshes, materials } = gltf(file);
  expect(materials.map(({ name }) => name).sort()).toEqual(["bar", "seam"]);
  // Both have walls, and a line around them.
  expect(meshes.map(({ primitives }) => primitives.map(({ mode, material }) => [mode ?? 4, materials[material].name])).sort()).toEqual(
    [[[1, "seam"]], [[1, "seam"]], [[4, "bar"]], [[4, "bar"]]],
  );
  const late = await open(browser, link);
  await live(late.page);
  await readingWhere(late.page, "Pieces", (pieces) => pieces === 2);
  expect(await reading(late.page, "Cut area")).toBeCloseTo(areaCm2, 0);
  expect([...problems, ...late.problems]).toEqual([]);
  await late.page.close();
  // Back to rest: whole again, for the hand that cut it too.
  await page.keyboard.press("r");
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  expect(await reading(page, "Cut area")).toBe(0);
});

test("voxels and links are drawn while somebody looks at them", async () => {
  const sessionId = await server.create(BAR);
  const { page, problems } = await open(browser, `${server.address}/?session=${sessionId}`);
  await live(page);
  await readingWhere(page, "Time", (timeS) => timeS > 0.1);
  const asked: string[] = [];
  page.on("request", (request) => asked.push(request.url()));
  const told = () => asked.filter((url) => url.endsWith("/GetInterior")).length;
  const style = page.locator("select[aria-label='What is drawn']");
  await style.selectOption("voxels");
  await expect.poll(told).toBeGreaterThan(2);
  await style.selectOption("links");
  await expect.poll(told).toBeGreaterThan(4);
  // Nobody asks for what nobody sees.
  await style.selectOption("tissue");
  await page.waitForTimeout(500);
  const before = told();
  await page.waitForTimeout(1000);
  expect(told()).toBe(before);
  expect(problems).toEqual([]);
});

test("what looks as it did is not drawn again", async () => {
  const sessionId = await server.create(BAR);
  const { page } = await open(browser, "about:blank");
  await page.addInitScript(() => {
    const counted = { draws: 0 };
    Object.assign(globalThis, counted);
    const { prototype } = WebGL2RenderingContext;
    Object.assign(prototype, {
      drawElements: new Proxy(Reflect.get(prototype, "drawElements") as () => void, {
        apply(draw, context, args) {
          (globalThis as unknown as typeof counted).draws += 1;
          Reflect.apply(draw, context, args);
        },
      }),
    });
  });
  await page.goto(`${server.address}/?session=${sessionId}`);
  await live(page);
  const draws = () => page.evaluate(() => (globalThis as unknown as { draws: number }).draws);
  // The bar sleeps, and its frames go on.
  const timeS = await readingWhere(page, "Time", (timeS) => timeS > 1);
  await expect.poll(draws).toBeGreaterThan(0);
  await expect.poll(async () => (await draws()) - (await page.waitForTimeout(1000).then(draws))).toBe(0);
  await readingWhere(page, "Time", (nowS) => nowS > timeS + 0.5);
  const before = await draws();
  await page.click("button:has-text('Blade')");
  await expect.poll(draws).toBeGreaterThan(before);
});

test("a session stands, steps and goes on, by keys", async () => {
  const sessionId = await server.create(BAR);
  const { page } = await open(browser, `${server.address}/?session=${sessionId}`);
  await live(page);
  const step = async () => Number((await server.sessions.describeSession({ sessionId })).session!.step);
  await page.keyboard.press(" ");
  await page.waitForSelector("button[aria-label='Go on']");
  const stood = await step();
  await page.keyboard.press(".");
  // A sixtieth of a second at 250 Hz.
  await expect.poll(step).toBe(stood + 4);
  await page.keyboard.press("s");
  await page.waitForSelector("text=Saved Point 1");
  await page.keyboard.press(" ");
  await page.waitForSelector("button[aria-label='Pause']");
  await expect.poll(step).toBeGreaterThan(stood + 10);
  // What is said twice stands once.
  for (let said = 0; said < 2; said++) {
    await server.sessions.resetSession({ sessionId });
    await page.waitForTimeout(500);
  }
  expect(await page.locator(".message:has-text('whole and at rest')").count()).toBe(1);
});

test("another stiffness begins another session, and the old one is ended by whoever began it", async () => {
  const { page } = await open(browser, server.address);
  await page.click('[data-scene="tofu"]');
  await live(page);
  const before = page.url();
  await page.click("button[aria-label='Change the scene']");
  const stiffness = page.locator("label:has-text('Stiffness') input");
  await stiffness.fill("3000000");
  await page.click("text=Begin with these");
  await page.waitForURL((url) => url.href !== before);
  const sessionId = new URL(page.url()).searchParams.get("session")!;
  const { session } = await server.sessions.describeSession({ sessionId });
  expect(session!.scene!.objects[0].youngModulusPa).toBe(3e6);
  await expect.poll(async () => {
    const { sessions } = await server.sessions.listSessions({});
    return sessions.some((other) => before.endsWith(other.sessionId));
  }).toBe(false);
});

test("over a slow link the picture comes seldom, but it comes", async () => {
  const sessionId = await server.create(BAR);
  const link = await slowLink(server.port, 60_000);
  const { page } = await open(browser, `${link.address}/?session=${sessionId}`);
  await live(page);
  const firstS = await readingWhere(page, "Time", (timeS) => timeS > 0);
  await readingWhere(page, "Time", (timeS) => timeS > firstS + 0.5);
  link.close();
});

test("a session that a restart lost is begun again", async () => {
  const sessionId = await server.create(BAR);
  const { page } = await open(browser, `${server.address}/?session=${sessionId}`);
  await live(page);
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  await server.stop();
  await page.waitForSelector('.connection[data-phase="lost"]');
  await server.start();
  await page.click("button:has-text('Begin it again')");
  await live(page);
  await readingWhere(page, "Time", (timeS) => timeS > 0);
});

test("a viewer of a server that was killed goes on by itself once there is another", async () => {
  const folder = await mkdtemp(join(tmpdir(), "kerf-journals-"));
  const journaled = new Server(await freePort(), [`journal_dir=${folder}`]);
  try {
    await journaled.start();
    const { page } = await open(browser, `${journaled.address}/?session=${await journaled.create(BAR)}`);
    await live(page);
    await readingWhere(page, "Time", (timeS) => timeS > 1);
    await journaled.stop();
    await page.waitForSelector('.connection[data-phase="lost"]');
    await journaled.start();
    const began = performance.now();
    await live(page);
    console.log(`the viewer is back ${((performance.now() - began) / 1000).toFixed(1)} s after the server answers`);
    await readingWhere(page, "Time", (timeS) => timeS > 1);
  } finally {
    await journaled.stop();
    await rm(folder, { recursive: true });
  }
});

test("a browser that cannot draw is told so, in words", async () => {
  const page = await browser.newPage();
  await page.addInitScript(() => {
    HTMLCanvasElement.prototype.getContext = () => null;
  });
  await page.goto(server.address);
  await page.waitForSelector("text=This browser cannot draw the tissue");
});

test("a cut's faces have a colour of their own", async () => {
  const session = await LockStep.begin(server, { text: APPLE });
  const view = "&view=0.02,0.09,0.09,0.002,0.012,0";
  const { page, problems } = await open(browser, `${server.address}/?session=${session.sessionId}${view}`);
  await live(page);
  const shown = () => page.waitForSelector(`[data-reading="Time"][title="Step ${session.step}"]`);
  const place = (y: number) => ({ at: [0, y, 0] as const, turn: ACROSS });
  await session.go({ tool: "blade", to: place(0.022) });
  await session.go({ tool: "blade", to: "lift" });
  await shown();
  const before = { pale: await paleShare(page), red: await redShare(page) };
  expect(before.red).toBeGreaterThan(0.05);
  await session.go({ tool: "blade", to: place(0.022) });
  await session.go({ tool: "blade", to: place(0.004), seconds: 0.2 });
  await session.go({ tool: "blade", to: "lift" });
  await session.wait(0.2);
  await shown();
  expect(await paleShare(page)).toBeGreaterThan(before.pale + 0.004);
  expect(problems).toEqual([]);
});

test.each([
  ["near", 1, 1e-3],
  ["far", 3, 1.5e-4],
])("a cut that has closed again is seen from %s", async (_, distance, least) => {
  const session = await LockStep.begin(server, { name: "tofu", stepRateHz: 125 });
  const eye = [0.06, 0.1, 0.16].map((at) => (at * distance).toFixed(3));
  const link = `${server.address}/?session=${session.sessionId}&view=${eye.join(",")},0,0.03,0`;
  const { page, problems } = await open(browser, link);
  await live(page);
  const shown = async () => {
    await page.waitForSelector(`[data-reading="Time"][title="Step ${session.step}"]`, { state: "attached" });
    // Until it is drawn as fine as the screen.
    await page.waitForTimeout(2500);
  };
  // Numbers that change are not of the tissue.
  await page.addStyleTag({ content: "body > :not(#stage) { opacity: 0; }" });
  const place = (y: number) => ({ at: [0.005, y, 0] as const, turn: ACROSS });
  await session.go({ tool: "blade", to: place(0.065) });
  await session.go({ tool: "blade", to: "lift" });
  await session.wait(0.3);
  await shown();
  const whole = await page.locator("#stage").screenshot();
  expect(await darkenedShare(page, whole)).toBe(0);
  await session.go({ tool: "blade", to: place(0.065) });
  await session.go({ tool: "blade", to: place(0.03), seconds: 0.4 });
  await session.go({ tool: "blade", to: place(0.065), seconds: 0.2 });
  await session.go({ tool: "blade", to: "lift" });
  await session.wait(2);
  await shown();
  const share = await darkenedShare(page, whole);
  // A line of one and a half pixels and more across the dome: some hundreds of the 448,000 pixels, and no more.
  expect(share).toBeGreaterThan(least);
  expect(share).toBeLessThan(1e-2);
  expect(problems).toEqual([]);
});

test("every built-in scene can be begun with a tool of each kind", async () => {
  const { scenes } = await server.sessions.listScenes({});
  for (const { name } of scenes) {
    const text = new SceneText(await server.textOf(name));
    text.addMissingTools();
    const scene = { case: "sceneToml" as const, value: text.toString() };
    const { session } = await server.sessions.createSession({ scene, startPaused: true });
    const kinds = new Set(session!.scene!.tools.map(({ kind }) => kind.case));
    expect([name, [...kinds].sort()]).toEqual([name, ["blade", "grasper", "probe", "scissors"]]);
    await server.sessions.closeSession({ sessionId: session!.sessionId });
  }
});

test("a grasper takes hold and pulls, by keys", async () => {
  const sessionId = await server.create(BAR);
  const { page } = await open(browser, `${server.address}/?session=${sessionId}`);
  await live(page);
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  await page.keyboard.press("2");
  // From the air down into the tissue: its middle stands some 8 mm over it, and a key goes 0.8 mm.
  for (let i = 0; i < 11; i++) await page.keyboard.press("ArrowDown");
  await expect.poll(async () => (await page.textContent("#tools [aria-pressed=true]")) ?? "").toContain("Grasper");
  // By the session's time: the server may be busier than the clock knows.
  const later = async () => {
    const now = await reading(page, "Time");
    await readingWhere(page, "Time", (timeS) => timeS > now + 1.5);
  };
  await later();
  await page.keyboard.press("c");
  await later();
  const before = await joules(page, "Stored");
  for (let i = 0; i < 6; i++) await page.keyboard.press("ArrowUp");
  await expect.poll(() => joules(page, "Stored"), { timeout: 20_000 }).toBeGreaterThan(2 * before + 1e-5);
});

test("a page that is busy does not hold a tool up", async () => {
  const sessionId = await server.create(BAR);
  const { page } = await open(browser, `${server.address}/?session=${sessionId}`);
  await live(page);
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  await page.keyboard.press("1");
  let sent = 0;
  page.on("request", (request) => (sent += Number(request.url().endsWith("/SendPose"))));
  await expect.poll(() => sent).toBeGreaterThan(0);
  const before = sent;
  await page.evaluate(async () => {
    // Wanted five centimetres up, which takes a tool most of a second; the page is busy from the next picture on.
    for (let i = 0; i < 60; i++) window.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowUp" }));
    for (let i = 0; i < 2; i++) await new Promise(requestAnimationFrame);
    const until = performance.now() + 1000;
    while (performance.now() < until);
  });
  expect(sent).toBeGreaterThan(before + 8);
});

/** What is looked at of a GLB. */
interface Gltf {
  meshes: { primitives: { attributes: { POSITION: number }; indices?: number; mode?: number; material: number }[] }[];
  materials: { name: string }[];
  accessors: { min: number[]; max: number[]; count: number; byteOffset?: number; bufferView: number; componentType: number }[];
  bufferViews: { byteOffset?: number }[];
}

function gltf(file: Buffer): Gltf {
  return JSON.parse(file.subarray(20, 20 + file.readUInt32LE(12)).toString()) as Gltf;
}

/** Of each mesh of triangles: edges that no other of its triangles passes the other way. A closed body has none. */
function edgesThatAreOpen(file: Buffer): number[] {
  const { meshes, accessors, bufferViews } = gltf(file);
  const binary = 28 + file.readUInt32LE(12);
  const ofTriangles = meshes.filter(({ primitives: [{ mode }] }) => mode !== 1);
  return ofTriangles.map(({ primitives }) => {
    // Parts of a piece have the same vertices.
    expect(new Set(primitives.map(({ attributes }) => attributes.POSITION)).size).toBe(1);
    const edges = new Set<string>();
    for (const { indices } of primitives) {
      const { count, bufferView, byteOffset, componentType } = accessors[indices!];
      const at = binary + (bufferViews[bufferView].byteOffset ?? 0) + (byteOffset ?? 0);
      const isShort = componentType === 5123;
      const vertex = (i: number) => (isShort ? file.readUInt16LE(at + 2 * i) : file.readUInt32LE(at + 4 * i));
      for (let i = 0; i < count; i += 3) {
        const [a, b, c] = [vertex(i), vertex(i + 1), vertex(i + 2)];
        for (const edge of [`${a} ${b}`, `${b} ${c}`, `${c} ${a}`]) edges.add(edge);
      }
    }
    return [...edges].filter((edge) => !edges.has(edge.split(" ").reverse().join(" "))).length;
  });
}

test("a picture, the surface and a link can be taken along", async () => {
  const sessionId = await server.create(BAR);
  const { page } = await open(browser, `${server.address}/?session=${sessionId}`);
  await live(page);
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  const saved = async (label: string) => {
    const [download] = await Promise.all([page.waitForEvent("download"), page.click(`button[aria-label='${label}']`)]);
    return readFile(await download.path());
  };
  const picture = await saved("Save a picture");
  expect(picture.subarray(1, 4).toString()).toBe("PNG");
  const glb = await saved("Save the surface as GLB");
  expect(glb.subarray(0, 4).toString()).toBe("glTF");
  const { meshes, accessors } = gltf(glb);
  const { POSITION } = meshes[0].primitives[0].attributes;
  expect(accessors[POSITION].max[0] - accessors[POSITION].min[0]).toBeCloseTo(0.06, 2);
  expect(edgesThatAreOpen(glb)).toEqual([0]);
  // The link says what is looked at, and from where: whoever opens it sees the same.
  await page.mouse.move(400, 250);
  await page.mouse.down();
  await page.mouse.move(520, 300, { steps: 8 });
  await page.mouse.up();
  await page.waitForTimeout(1000);
  await page.click("button[aria-label='Copy a link to this session']");
  await page.waitForURL((url) => url.searchParams.has("view"));
  const there = await open(browser, page.url());
  await live(there.page);
  await there.page.click("button[aria-label='Copy a link to this session']");
  await there.page.waitForTimeout(200);
  expect(there.page.url()).toBe(page.url());
});

const SCREENS = [
  { name: "a phone", width: 390, height: 844 },
  { name: "a tablet", width: 820, height: 1180 },
];

test.each(SCREENS)("on $name every control is in reach of a finger", async ({ width, height }) => {
  const others = `
[[tools]]
name = "probe"
shape = { probe = { radius_m = 0.008 } }
[[tools]]
name = "scissors"
shape = { scissors = { blade_length_m = 0.03, blade_height_m = 0.005 } }
`;
  const sessionId = await server.create(BAR + others);
  const screen = { width, height, hasTouch: true };
  const { page, problems } = await open(browser, `${server.address}/?session=${sessionId}`, screen);
  await live(page);
  await page.tap("button:has-text('Grasper')");
  await page.waitForSelector("button[aria-label='Close or open the jaws']:visible");
  // All that can be pressed, without a way to scroll: whole, on the page, large enough, and not under something else.
  const look = () =>
    page.evaluate(() =>
      [...document.querySelectorAll<HTMLElement>("button, select")]
        .filter((control) => control.checkVisibility())
        .map((control) => {
          const { left, top, right, bottom, width, height } = control.getBoundingClientRect();
          const name = control.getAttribute("aria-label") ?? control.textContent;
          const isOnPage = left >= 0 && top >= 0 && right <= innerWidth && bottom <= innerHeight;
          const above = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
          return { name, isOnPage, isClear: control.contains(above), side: Math.min(width, height) };
        }),
    );
  // A bar that has wrapped moves those above it with the next picture, which may take its time.
  const areClear = async () => (await look()).every(({ isOnPage, isClear }) => isOnPage && isClear);
  await expect.poll(areClear).toBe(true);
  const controls = await look();
  const names = controls.map(({ name }) => name);
  for (const name of ["Look", "Blade", "Probe", "Pause", "Draw the forces", "Save a picture", "Save the surface as GLB"]) {
    expect(names).toContain(name);
  }
  for (const name of ["Put the tool away", "Help", "Dark or light", "Scenes and sessions", "Away", "Turn left"]) {
    expect(names).toContain(name);
  }
  for (const { name, side } of controls) expect([name, side >= 44]).toEqual([name, true]);
  expect(await page.locator("#top .scene").boundingBox()).toMatchObject({ height: expect.any(Number) as number });
  expect(await page.locator("#top .scene").textContent()).toBe("Bar");
  // A word in passing covers no reading, nor does what stands.
  await page.tap("button[aria-label='Save a point to go back to']");
  await page.waitForSelector("text=Saved Point 1");
  const boxes = async (selector: string) => {
    const found = await page.locator(selector).all();
    return (await Promise.all(found.map((one) => one.boundingBox()))).filter((box) => box !== null);
  };
  for (const message of await boxes(".message")) {
    for (const reading of await boxes("#readings .panel")) {
      const isApart =
        message.x + message.width <= reading.x ||
        reading.x + reading.width <= message.x ||
        message.y + message.height <= reading.y ||
        reading.y + reading.height <= message.y;
      expect([message, reading, isApart]).toEqual([message, reading, true]);
    }
  }
  // All readings, at a press where they are not all there.
  const all = page.locator("button[aria-label='All readings']");
  if (await all.isVisible()) await all.tap();
  expect(await page.locator("output[data-reading='Pieces']").isVisible()).toBe(true);
  expect(problems).toEqual([]);
});

type Point = readonly [number, number];

/** Puts fingers down, the second after the first, moves them evenly and lifts them, the second before the first. */
async function gesture(page: Page, from: readonly Point[], to: readonly Point[]): Promise<void> {
  const cdp = await page.context().newCDPSession(page);
  const touch = (type: "touchStart" | "touchMove" | "touchEnd", fingers: readonly Point[]) => {
    return cdp.send("Input.dispatchTouchEvent", { type, touchPoints: fingers.map(([x, y], id) => ({ x, y, id })) });
  };
  for (let count = 1; count <= from.length; count++) await touch("touchStart", from.slice(0, count));
  const steps = 6;
  for (let i = 1; i <= steps; i++) {
    const between = (a: number, b: number) => a + ((b - a) * i) / steps;
    await touch("touchMove", from.map(([x, y], finger) => [between(x, to[finger][0]), between(y, to[finger][1])]));
    await page.waitForTimeout(30);
  }
  for (let count = to.length - 1; count >= 0; count--) await touch("touchEnd", to.slice(0, count));
  await cdp.detach();
}

/** How far from what it looks at a page looks from, m, and in which direction from there. */
async function lookOf(page: Page): Promise<{ distanceM: number; direction: Vector3 }> {
  await page.tap("button[aria-label='Copy a link to this session']");
  await page.waitForURL((url) => url.searchParams.has("view"));
  const [x, y, z, ...target] = new URL(page.url()).searchParams.get("view")!.split(",").map(Number);
  const line = new Vector3(x, y, z).sub(new Vector3(...target));
  return { distanceM: line.length(), direction: line.normalize() };
}

test("on a phone two fingers zoom and turn the view, and move no tool", async () => {
  const sessionId = await server.create(BAR);
  const screen = { width: 390, height: 844, deviceScaleFactor: 0.5, hasTouch: true };
  const { page, problems } = await open(browser, `${server.address}/?session=${sessionId}`, screen);
  await live(page);
  await readingWhere(page, "Pieces", (pieces) => pieces === 1);
  const poses: string[] = [];
  page.on("request", (request) => {
    const body = request.postDataBuffer();
    if (!request.url().endsWith("/SendPose") || !body) return;
    // Behind a message's flag and length.
    const { motion } = fromBinary(SendPoseRequestSchema, body.subarray(5));
    if (motion.case === "pose") poses.push(JSON.stringify(motion.value.pose));
  });
  /** Poses that are sent from now on, of which some come while the tool stands still. */
  const nextPoses = async () => {
    poses.length = 0;
    await expect.poll(() => poses.length).toBeGreaterThan(2);
    return [...new Set(poses)];
  };
  await page.tap("button:has-text('Blade')");
  await expect.poll(async () => (await nextPoses()).length).toBe(1);
  const stood = await nextPoses();
  const before = await lookOf(page);
  await gesture(page, [[180, 330], [210, 330]], [[100, 330], [290, 330]]);
  await expect.poll(async () => (await lookOf(page)).distanceM).toBeLessThan(0.8 * before.distanceM);
  const near = await lookOf(page);
  const turnedBy = async ({ direction }: typeof near) => (await lookOf(page)).direction.angleTo(direction);
  await gesture(page, [[140, 280], [200, 280]], [[190, 380], [250, 380]]);
  await expect.poll(() => turnedBy(near)).toBeGreaterThan(0.3);
  expect([...new Set([...poses, ...(await nextPoses())])]).toEqual(stood);
  // One finger does move it, and not the view, which goes on turning a little.
  const turned = await lookOf(page);
  await gesture(page, [[190, 330]], [[250, 330]]);
  await expect.poll(async () => (await nextPoses()).includes(stood[0])).toBe(false);
  expect(await turnedBy(turned)).toBeLessThan(0.15);
  expect(problems).toEqual([]);
});

test("a page is dark or light as the system is, until somebody chooses", async () => {
  const sessionId = await server.create(BAR);
  const brightness = (page: Page) =>
    page.evaluate(() => getComputedStyle(document.body).backgroundColor.match(/\d+/g)!.map(Number)[0]);
  for (const colorScheme of ["dark", "light"] as const) {
    const { page } = await open(browser, `${server.address}/?session=${sessionId}`, { width: 800, height: 560, colorScheme });
    await live(page);
    const isLight = async () => (await brightness(page)) > 150;
    expect(await isLight()).toBe(colorScheme === "light");
    await page.emulateMedia({ colorScheme: colorScheme === "light" ? "dark" : "light" });
    await expect.poll(isLight).toBe(colorScheme !== "light");
    await page.click("button[aria-label='Dark or light']");
    expect(await isLight()).toBe(colorScheme === "light");
    await page.close();
  }
});

test("the first scene is the liver, at a rate that the machine keeps, without a red word", async () => {
  const { page, problems } = await open(browser, server.address, { width: 1280, height: 800 });
  await page.waitForSelector(".card");
  // A picture that cannot be had is taken away, and missed below.
  await page.waitForFunction(() => [...document.querySelectorAll("img")].every(({ complete }) => complete));
  const cards = await page.evaluate(() =>
    [...document.querySelectorAll<HTMLElement>(".card")].map((card) => ({
      name: card.dataset["scene"],
      hasPicture: (card.querySelector("img")?.naturalWidth ?? 0) > 0,
      isWhole: [...card.querySelectorAll("span")].every((span) => span.scrollHeight <= span.clientHeight),
    })),
  );
  expect(cards[0].name).toBe("liver-tissue");
  expect(cards.filter(({ hasPicture, isWhole }) => !hasPicture || !isWhole)).toEqual([]);
  await page.evaluate(() => {
    const told: number[] = ((window as unknown as { told: number[] }).told = []);
    const keep = () => told.push(document.querySelector<HTMLProgressElement>(".message.busy progress")?.value ?? 0);
    new MutationObserver(keep).observe(document.body, { subtree: true, attributes: true });
  });
  await page.click(".card");
  await page.waitForSelector("text=The server makes the tissue");
  await live(page);
  await page.waitForFunction(() => !document.querySelector(".message.busy"));
  // Something of it was told before it was there.
  const told = await page.evaluate(() => (window as unknown as { told: number[] }).told);
  expect(Math.max(...told)).toBeGreaterThan(0);
  await readingWhere(page, "Time", (timeS) => timeS > 1);
  expect(await page.locator(".problem").count()).toBe(0);
  const sessionId = new URL(page.url()).searchParams.get("session")!;
  const { session } = await server.sessions.describeSession({ sessionId });
  expect(session!.load).toBeLessThan(1);
  await server.sessions.closeSession({ sessionId });
  expect(problems).toEqual([]);
});

test("pieces that fall out of reach are told of", async () => {
  const sceneToml = `
    version = 1
    name = "crumb"
    rate_hz = 250.0
    gravity_m_per_s2 = [0.0, -9.81, 0.0]
    [[objects]]
    name = "crumb"
    shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.01, 0.01, 0.01] } }
    resolution = 4
    level = 1
    material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
  `;
  const scene = { case: "sceneToml" as const, value: sceneToml };
  const { session } = await server.sessions.createSession({ scene, startPaused: true });
  const { page, problems } = await open(browser, `${server.address}/?session=${session!.sessionId}`);
  await page.waitForSelector('[aria-label="Go on"]');
  await server.sessions.resumeSession({ sessionId: session!.sessionId });
  await page.waitForSelector("text=1 piece fell out of reach");
  expect(problems).toEqual([]);
});

test("the page of a session that moves goes on at the other server, with the same view", async () => {
  const other = new Server(await freePort());
  await other.start();
  try {
    const { page, problems } = await open(browser, server.address);
    await page.click('[data-scene="tofu"]');
    await live(page);
    const { sessions } = await server.sessions.listSessions({});
    const { sessionId } = sessions[0];
    await server.sessions.moveSession({ sessionId, to: other.address });
    await page.waitForURL((url) => url.origin === new URL(other.address).origin);
    await live(page);
    const there = new URL(page.url()).searchParams;
    expect([there.get("session"), there.get("view")?.split(",").length]).toEqual([sessionId, 6]);
    const timeS = await readingWhere(page, "Time", (nowS) => nowS > 0);
    await readingWhere(page, "Time", (laterS) => laterS > timeS);
    expect(problems).toEqual([]);
    await page.close();
    // Who opens the old link comes there too.
    const late = await open(browser, `${server.address}/?session=${sessionId}`);
    await late.page.waitForURL((url) => url.origin === new URL(other.address).origin);
    await live(late.page);
  } finally {
    await other.stop();
  }
});

test("a session that is not there is said in words, with what to do", async () => {
  const { page } = await open(browser, `${server.address}/?session=nobody`);
  await page.waitForSelector("text=This session cannot be joined");
  await page.click("button:has-text('Choose a scene')");
  await page.waitForSelector('[data-scene="tofu"]');
});

test("the link of a server that asks for a token opens it, and whoever has none is asked", async () => {
  const { link, stop } = await startSecured();
  try {
    const token = new URLSearchParams(link.hash.slice(1)).get("token")!;
    const { page, problems } = await open(browser, link.href);
    await page.click('[data-scene="jelly"]');
    await live(page);
    await page.click("button:has-text('Blade')");
    await readingWhere(page, "Round trip", (milliseconds) => milliseconds > 0);
    expect(page.url()).not.toContain(token);
    await page.context().grantPermissions(["clipboard-read", "clipboard-write"]);
    await page.click("button[aria-label*='link']");
    await page.waitForSelector("text=The link is copied");
    const shared = await page.evaluate(() => navigator.clipboard.readText());
    expect(shared).toContain("#token=");
    expect(shared).not.toContain(token);
    // The tab keeps it.
    await page.goto(link.origin);
    await page.waitForSelector('[data-scene="jelly"]');
    expect(problems).toEqual([]);
    await page.context().close();

    const { page: stranger } = await open(browser, link.origin);
    const asks = stranger.locator("dialog[aria-label='Sign in'] input");
    await asks.fill("wrong");
    await Promise.all([stranger.waitForEvent("load"), asks.press("Enter")]);
    await asks.fill(token);
    await asks.press("Enter");
    await stranger.waitForSelector('[data-scene="tofu"]');
    expect(await stranger.evaluate(() => document.cookie + JSON.stringify(localStorage))).toBe("{}");
    await stranger.context().close();

    const { page: guest } = await open(browser, shared);
    await live(guest);
    await guest.click("button:has-text('Blade')");
    await guest.waitForSelector("text=takes a driver's");
  } finally {
    await stop();
  }
});

test("a private session is seen by its owner alone, and stays private when it is begun anew", async () => {
  const { linkOf, stop } = await startSecured();
  try {
    const [anna, ben] = [await linkOf("anna", "driver"), await linkOf("ben", "driver")];
    const { page, problems } = await open(browser, anna.href);
    const shown = () => new URL(page.url()).searchParams.get("session");
    await page.check("input[name='private']");
    await page.click('[data-scene="tofu"]');
    await live(page);
    expect(await seenBy(anna)).toEqual([shown()]);
    expect(await seenBy(ben)).toEqual([]);

    // The same scene with other numbers is another session, which is as private.
    const before = page.url();
    await page.click("button[aria-label='Change the scene']");
    await page.locator("label:has-text('Stiffness') input").fill("3000000");
    await page.click("text=Begin with these");
    await page.waitForURL((url) => url.href !== before);
    await live(page);
    expect(await seenBy(anna)).toContain(shown());
    expect(await seenBy(ben)).toEqual([]);
    expect(problems).toEqual([]);

    // What is not begun in private others see.
    await page.goto(new URL("/", page.url()).href);
    await page.click('[data-scene="jelly"]');
    await live(page);
    expect(await seenBy(ben)).toEqual([shown()]);
  } finally {
    await stop();
  }
});
