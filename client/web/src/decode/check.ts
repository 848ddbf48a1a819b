// Everything that comes in is checked before it is used; the error names the field of the message.

/** Why a message was refused. */
export class ReplicaError extends Error {
  /** Nothing but a keyframe helps; else only the message itself is lost. */
  readonly needsKeyframe: boolean;

  constructor(message: string, needsKeyframe: boolean) {
    super(message);
    this.needsKeyframe = needsKeyframe;
  }
}

/** What is wrong with a field of an object. */
export class FieldError extends Error {
  constructor(field: string, problem: string) {
    super(`${field}: ${problem}`);
  }
}

export function checkLength(field: string, values: ArrayLike<number>, expected: number): void {
  if (values.length !== expected) throw new FieldError(field, `${values.length} entries, ${expected} expected`);
}

export function checkFinite(field: string, values: ArrayLike<number>): void {
  for (let i = 0; i < values.length; i++) {
    if (!Number.isFinite(values[i])) throw new FieldError(field, `entry ${i} is not finite`);
  }
}

export function checkAscending(field: string, ids: ArrayLike<number>): void {
  for (let i = 1; i < ids.length; i++) {
    if (ids[i] <= ids[i - 1]) throw new FieldError(field, `entry ${i}, id ${ids[i]}, is not above the one before it`);
  }
}

export function unknownId(field: string, id: number): FieldError {
  return new FieldError(field, `id ${id} does not exist`);
}
