// The viewer in a real browser, against a real server.

import type { Browser } from "playwright-core";
import { afterAll, afterEach, beforeAll, expect, test } from "vitest";
import { BAR, freePort, launch, live, open, reading, readingWhere, redShare, Server, slowLink } from "./harness";

let browser: Browser;
let server: Server;

beforeAll(async () => {
  server = new Server(await freePort());
  await server.start();
  browser = await launch();
});

// A page that is left open goes on drawing, which slows the others down.
afterEach(() => Promise.all(browser.contexts().map((context) => context.close())));

afterAll(async () => {
  await browser?.close();
  await server?.stop();
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
  // The bar's section is 20 mm x 20 mm.
  const areaCm2 = await reading(page, "Cut area");
  expect(areaCm2).toBeGreaterThan(2.5);
  expect(areaCm2).toBeLessThan(6);
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

test("a browser that cannot draw is told so, in words", async () => {
  const page = await browser.newPage();
  await page.addInitScript(() => {
    HTMLCanvasElement.prototype.getContext = () => null;
  });
  await page.goto(server.address);
  await page.waitForSelector("text=This browser cannot draw the tissue");
});
