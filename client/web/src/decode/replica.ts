// A copy of what a session shows: built from a keyframe, kept by patches, moved by states. After each change of
// structure the surface's hash is compared with the server's, but for plain vertices, which have none.
//
// Deliberately absent: network, drawing, and any knowledge of the physics.

import {
  type BodyState,
  type BodyStructure,
  type Keyframe,
  type State,
  SurfaceEncoding,
  type TopologyPatch,
} from "../gen/kerf/v1/view_pb";
import { Body, MAX_NODES } from "./body";
import { FieldError, ReplicaError } from "./check";
import { surfaceHash } from "./hash";

/** The objects at one version of their structure. */
export class Replica {
  private version: bigint | undefined;
  /** Step of the reference of the displacements, once one has come. */
  private referenceStep: bigint | undefined;
  private objects: Body[] = [];

  /** The objects, in the order of the scene; none before the first keyframe. */
  get bodies(): readonly Body[] {
    return this.objects;
  }

  /** Replaces the whole structure; an object that has the same as before stays the same one. */
  applyKeyframe(keyframe: Keyframe): void {
    this.version = undefined;
    this.referenceStep = undefined;
    const before = this.objects;
    const hasPlainVertices = keyframe.encoding === SurfaceEncoding.VERTICES;
    this.objects = keyframe.bodies.map(() => new Body(hasPlainVertices));
    this.change("keyframe", keyframe.bodies, keyframe.topologyVersion, keyframe.surfaceHash);
    this.objects = this.objects.map((body, index) => {
      const old = before.at(index);
      return old?.hasStructureOf(body) ? old : body;
    });
  }

  /** Changes the structure. A patch that fails half-way, or leads to another hash, costs the structure. */
  applyPatch(patch: TopologyPatch): void {
    const { fromVersion, toVersion } = patch;
    if (this.version === undefined) throw new ReplicaError("no keyframe yet", true);
    if (fromVersion !== this.version || toVersion <= fromVersion) {
      throw new ReplicaError(`patch leads from version ${fromVersion} to ${toVersion}, not from ${this.version}`, true);
    }
    this.version = undefined;
    this.change("patch", patch.bodies, toVersion, patch.surfaceHash);
  }

  /** Moves the nodes. A state that is refused costs nothing but itself, unless structure was missed. */
  applyState(state: State): void {
    if (this.version === undefined) throw new ReplicaError("no keyframe yet", true);
    if (state.topologyVersion !== this.version) {
      const isAhead = state.topologyVersion > this.version;
      throw new ReplicaError(`state of version ${state.topologyVersion}, not ${this.version}`, isAhead);
    }
    checkCount("state", state.bodies, this.objects);
    const { hasReference, referenceStep } = state;
    if (!hasReference && referenceStep !== this.referenceStep) {
      throw new ReplicaError(`state refers to that of step ${referenceStep}, which did not come`, true);
    }
    this.each("state", state.bodies, (body, moved) => body.readState(moved, hasReference));
    for (const body of this.objects) body.displace(hasReference);
    this.referenceStep = referenceStep;
  }

  private change(message: string, changes: BodyStructure[], version: bigint, hash: bigint): void {
    checkCount(message, changes, this.objects);
    let room = MAX_NODES;
    this.each(message, changes, (body, change) => {
      body.change(change, room);
      room -= change.nodeCount;
    });
    const computed = surfaceHash(this.objects.map((body) => body.hashSum));
    const isHashed = this.objects.some((body) => !body.hasPlainVertices);
    if (isHashed && computed !== hash) {
      const [ours, theirs] = [computed, hash].map((value) => value.toString(16).padStart(16, "0"));
      throw new ReplicaError(`surface hash at version ${version} is ${ours}, server says ${theirs}`, true);
    }
    this.version = version;
  }

  private each<T extends BodyState | BodyStructure>(
    message: string,
    parts: T[],
    apply: (body: Body, part: T) => void,
  ): void {
    parts.forEach((part, index) => {
      try {
        apply(this.objects[index], part);
      } catch (error) {
        if (!(error instanceof FieldError)) throw error;
        throw new ReplicaError(`${message}.bodies[${index}].${error.message}`, message !== "state");
      }
    });
  }
}

function checkCount(message: string, parts: unknown[], objects: Body[]): void {
  if (parts.length !== objects.length) {
    const problem = `${message}.bodies: ${parts.length} entries, ${objects.length} expected`;
    throw new ReplicaError(problem, message !== "state");
  }
}
