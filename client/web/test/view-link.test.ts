import { Vector3 } from "three";
import { expect, test } from "vitest";
import { viewLink, viewOf } from "../src/view-link";

test("a link says which session, and from where it is looked at", () => {
  const view = { eye: new Vector3(0.1, 0.25, -0.4), target: new Vector3(0, 0.03, 0) };
  const link = viewLink("http://host:50051/?session=old&view=1,2,3,4,5,6", "a b", view);
  expect(link).toBe("http://host:50051/?session=a+b&view=0.1,0.25,-0.4,0,0.03,0");
  expect(viewOf(new URL(link).search)).toEqual(view);
});

test("without a view the scene is framed as usual", () => {
  expect(viewOf("?session=a")).toBeUndefined();
  expect(viewLink("http://host/", "a")).toBe("http://host/?session=a");
});

test("what cannot be looked from is no view", () => {
  for (const view of ["1,2,3", "1,2,3,4,5,x", "1,2,3,1,2,3", "1,2,3,4,5,Infinity", "1,2,3,4,5,1000"]) {
    expect(viewOf(`?view=${view}`)).toBeUndefined();
  }
});
