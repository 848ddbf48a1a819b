using System;

namespace Kerf.Client
{
    /// <summary>The surface hash, as view.proto specifies it. Arithmetic wraps.</summary>
    public static class SurfaceHash
    {
        // In the place where a vertex has its material, which is below both.
        const uint QuadMark = 1 << 16, HeldMark = 1 << 17;

        /// <summary>Of a vertex bound to an element at local coordinates, in a voxel of a material.</summary>
        public static ulong OfVertex(uint id, uint element, float u, float v, float w, uint material)
        {
            return OfWords(id, element, Bits(u), Bits(v), material, Bits(w));
        }

        /// <summary>Of the eight weights of a vertex beside what is held.</summary>
        public static ulong OfHeld(uint id, float[] weights)
        {
            return OfWords(id, Bits(weights[0]), Bits(weights[1]), Bits(weights[2]), Bits(weights[3]), Bits(weights[4]),
                Bits(weights[5]), Bits(weights[6]), HeldMark, Bits(weights[7]));
        }

        /// <summary>Of a quad.</summary>
        public static ulong OfQuad(uint id, uint a, uint b, uint c, uint d)
        {
            return OfWords(id, a, b, c, QuadMark, d);
        }

        /// <summary>Folds the sum of one object into the hash of those before it.</summary>
        public static ulong Fold(ulong hash, ulong word)
        {
            unchecked
            {
                var x = (hash ^ word) + 0x9e3779b97f4a7c15UL;
                x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9UL;
                x = (x ^ (x >> 27)) * 0x94d049bb133111ebUL;
                return x ^ (x >> 31);
            }
        }

        // Of words told by their halves, the upper one first.
        static ulong OfWords(params uint[] halves)
        {
            ulong hash = 0;
            for (var i = 0; i < halves.Length; i += 2) hash = Fold(hash, (ulong)halves[i] << 32 | halves[i + 1]);
            return hash;
        }

        static uint Bits(float value)
        {
            return unchecked((uint)BitConverter.ToInt32(BitConverter.GetBytes(value), 0));
        }
    }
}
