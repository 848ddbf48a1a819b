import { PerspectiveCamera, Quaternion, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { Hand } from "../src/hand";

const HEIGHT_PX = 1000;
const SCENE_M = 0.1;

/** Looks down on a scene of 0.1 m. */
function above(): PerspectiveCamera {
  const camera = new PerspectiveCamera(45, 1, 0.01, 10);
  camera.position.set(0, 0.3, 0.05);
  camera.lookAt(0, 0, 0);
  camera.updateMatrixWorld();
  return camera;
}

function edgeOf(hand: Hand): Vector3 {
  return new Vector3(1, 0, 0).applyQuaternion(new Quaternion(...hand.goal.orientation));
}

describe("a tool that is drawn", () => {
  it("has its edge along the curve that the drag goes, either end first", () => {
    for (const forward of [1, -1]) {
      const hand = new Hand(0, SCENE_M, new Vector3(), new Quaternion());
      const camera = above();
      // To the right, and from there in a quarter of a circle of 300 px upwards, or all of it the other way round.
      const steps = 200;
      for (let i = 0; i < steps; i++) {
        const angle = (Math.PI / 2) * ((i + 0.5) / steps);
        const stepPx = (forward * 300 * Math.PI) / 2 / steps;
        hand.drag("draw", stepPx * Math.cos(angle), -stepPx * Math.sin(angle), camera, HEIGHT_PX);
      }
      const edge = edgeOf(hand);
      // Up on the screen is away, -z. It comes after by the way over which it comes round, over the radius.
      const lagRad = Math.atan2(edge.x, -edge.z);
      expect(lagRad).toBeGreaterThan(0);
      expect(lagRad).toBeLessThan(0.15);
      expect(edge.y).toBeCloseTo(0, 9);
      const [x, y, z] = hand.goal.position;
      expect(Math.sign(x)).toBe(forward);
      expect(Math.sign(-z)).toBe(forward);
      expect(y).toBeCloseTo(0, 9);
    }
  });

  it("is not turned by a drag along its edge, there or back", () => {
    const hand = new Hand(0, SCENE_M, new Vector3(), new Quaternion());
    for (const xPx of [40, -80, 40]) hand.drag("draw", xPx, 0, above(), HEIGHT_PX);
    expect(edgeOf(hand).distanceTo(new Vector3(1, 0, 0))).toBeLessThan(1e-9);
    // Pixels are worth a little more where the tool is farther off.
    expect(new Vector3(...hand.goal.position).length()).toBeLessThan(1e-4);
  });
});
