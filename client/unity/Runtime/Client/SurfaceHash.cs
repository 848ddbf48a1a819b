using System;

namespace Kerf.Client
{
    /// <summary>The surface hash, as view.proto specifies it. Arithmetic wraps.</summary>
    public static class SurfaceHash
    {
        /// <summary>Of a vertex bound to an element at local coordinates.</summary>
        public static ulong OfVertex(uint id, uint element, float u, float v, float w)
        {
            return OfItem(0, id, element, Bits(u), Bits(v), Bits(w));
        }

        /// <summary>Of a quad.</summary>
        public static ulong OfQuad(uint id, uint a, uint b, uint c, uint d)
        {
            return OfItem(1, id, a, b, c, d);
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

        static ulong OfItem(ulong kind, uint id, uint a, uint b, uint c, uint d)
        {
            var first = Fold(0, (ulong)id << 32 | a);
            return Fold(Fold(first, (ulong)b << 32 | c), kind << 32 | d);
        }

        static uint Bits(float value)
        {
            return unchecked((uint)BitConverter.ToInt32(BitConverter.GetBytes(value), 0));
        }
    }
}
