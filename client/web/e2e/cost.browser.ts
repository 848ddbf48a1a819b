// What a picture costs the page, measured in a browser: the first one after a load, and handing the arrays of a state of
// 20,000 vertices to the graphics card. Figures are of the machine; none is asserted.

import { expect, test } from "vitest";
import { browser, live, open, server, useBrowserAndServer } from "./harness";

/** A slab of 96 x 4 x 96 voxels: some 20,000 vertices. */
const SLAB = `
version = 1
name = "slab"
rate_hz = 60.0
[[objects]]
name = "slab"
shape = { box = { min_m = [-0.096, 0.0, -0.096], max_m = [0.096, 0.008, 0.096] } }
voxel_size_m = 0.002
material = { young_modulus_pa = 3.0e4, poisson_ratio = 0.4, rayleigh_alpha_per_s = 0.1 }
fixed = [{ box = { min_m = [-1.0, -1.0, -1.0], max_m = [-0.09, 1.0, 1.0] } }]
`;
const LOADS = 5;

interface Pictures {
  pictures: { ms: number; bytes: number }[];
}
type Call = (...given: unknown[]) => void;

useBrowserAndServer();

function quantiles(values: number[]): string {
  values.sort((a, b) => a - b);
  const at = (share: number) => values[Math.floor(share * (values.length - 1))].toFixed(2);
  return `least ${at(0)}, median ${at(0.5)}, most ${at(1)} (${values.length})`;
}

test("the first picture after a load", async () => {
  const sessionId = await server.create(SLAB);
  const times: number[] = [];
  for (let i = 0; i < LOADS; i++) {
    const { page } = await open(browser, `${server.address}/?session=${sessionId}`);
    await page.waitForFunction(() => performance.getEntriesByName("kerf-first-picture").length > 0);
    times.push(
      await page.evaluate(() => {
        const [load] = performance.getEntriesByType("navigation") as PerformanceNavigationTiming[];
        return performance.getEntriesByName("kerf-first-picture")[0].startTime - load.loadEventEnd;
      }),
    );
    await page.close();
  }
  console.log(`first picture after load, ms: ${quantiles(times)}`);
  expect(times).toHaveLength(LOADS);
});

test("handing a state to the graphics card", async () => {
  const sessionId = await server.create(SLAB.replace("rate_hz = 60.0", "rate_hz = 60.0\ngravity_m_per_s2 = [0.0, -1.0, 0.0]"));
  const page = await browser.newPage({ viewport: { width: 320, height: 240 } });
  await page.addInitScript(() => {
    const pictures: Pictures["pictures"] = [];
    Object.assign(window, { pictures });
    for (const name of ["bufferData", "bufferSubData"] as const) {
      const call = Object.getOwnPropertyDescriptor(WebGL2RenderingContext.prototype, name)!.value as Call;
      const timed = function (this: WebGL2RenderingContext, ...given: unknown[]) {
        const begun = performance.now();
        call.apply(this, given);
        const picture = pictures[pictures.length - 1];
        picture.ms += performance.now() - begun;
        picture.bytes += given.find((value) => ArrayBuffer.isView(value))?.byteLength ?? 0;
      };
      Object.assign(WebGL2RenderingContext.prototype, { [name]: timed });
    }
    const next = () => {
      pictures.push({ ms: 0, bytes: 0 });
      requestAnimationFrame(next);
    };
    next();
  });
  await page.goto(`${server.address}/?session=${sessionId}`);
  await live(page);
  // Positions and two kinds of normals of every vertex.
  const enough = () => (window as unknown as Pictures).pictures.filter(({ bytes }) => bytes > 684_000).length > 20;
  await page.waitForFunction(enough);
  const pictures = await page.evaluate(() => (window as unknown as Pictures).pictures);
  // The first picture brings the structure too.
  const states = pictures.filter(({ bytes }) => bytes > 684_000).slice(1);
  console.log(`upload of ${states[0].bytes} bytes, ms: ${quantiles(states.map(({ ms }) => ms))}`);
  expect(states.length).toBeGreaterThan(10);
  await page.close();
});
