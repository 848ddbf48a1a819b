// Arrays that grow, and items that have an id on the wire and a slot in such arrays.

type Numbers = Float32Array | Uint32Array | Uint8Array;

/** The array itself if it holds `length` numbers, else a longer copy with room to spare. */
export function grown<T extends Numbers>(array: T, length: number): T {
  if (array.length >= length) return array;
  const longer = new (array.constructor as new (length: number) => T)(Math.ceil(length * 1.25));
  longer.set(array);
  return longer;
}

/** Slots of ids, in the order in which the ids first came. */
export class Slots {
  private readonly slotOf = new Map<number, number>();

  get count(): number {
    return this.slotOf.size;
  }

  get(id: number): number | undefined {
    return this.slotOf.get(id);
  }

  /** By slot here, the slot that the same id has in another store; -1: none. */
  slotsIn(other: Slots): Int32Array {
    const slots = new Int32Array(this.slotOf.size);
    for (const [id, slot] of this.slotOf) slots[slot] = other.slotOf.get(id) ?? -1;
    return slots;
  }

  /** The slot of an id, a new one where it had none. */
  claim(id: number): number {
    const known = this.slotOf.get(id);
    if (known !== undefined) return known;
    const slot = this.slotOf.size;
    this.slotOf.set(id, slot);
    return slot;
  }
}
