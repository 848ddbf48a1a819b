using System.Collections.Generic;
using UnityEngine;

namespace Kerf.Unity
{
    /// <summary>The lines where cuts meet the outside, on vertices of their own that stand out from it: lines in the surface
    /// itself are hidden by it here and there.</summary>
    sealed class SeamLine
    {
        // Vertices of the surface that the lines go through, and corners of the outside's triangles around these.
        readonly List<int> through = new List<int>();
        readonly List<int> around = new List<int>();
        readonly Dictionary<int, int> place = new Dictionary<int, int>();
        Vector3[] normals = new Vector3[0];

        /// <summary>How many vertices it has.</summary>
        public int Count => through.Count;

        /// <summary>Takes other lines, two vertices of the surface each, and returns them by the vertices here, of which
        /// the first follows the last of the surface.</summary>
        public int[] Restructure(int[] seam, int[] outside, int surfaceCount)
        {
            through.Clear();
            around.Clear();
            place.Clear();
            var lines = new int[seam.Length];
            for (var end = 0; end < seam.Length; end++)
            {
                if (!place.TryGetValue(seam[end], out var at))
                {
                    at = place[seam[end]] = through.Count;
                    through.Add(seam[end]);
                }
                lines[end] = surfaceCount + at;
            }
            for (var corner = 0; corner < outside.Length; corner += 3)
            {
                var isNear = place.ContainsKey(outside[corner]) || place.ContainsKey(outside[corner + 1]) || place.ContainsKey(outside[corner + 2]);
                for (var of = 0; isNear && of < 3; of++) around.Add(outside[corner + of]);
            }
            normals = new Vector3[through.Count];
            return lines;
        }

        /// <summary>Writes where they are, after where the surface is: by so much above it.</summary>
        public void Raise(Vector3[] vertices, float heightM)
        {
            System.Array.Clear(normals, 0, normals.Length);
            for (var corner = 0; corner < around.Count; corner += 3)
            {
                var from = vertices[around[corner]];
                // As long as the triangle is large.
                var normal = Vector3.Cross(vertices[around[corner + 1]] - from, vertices[around[corner + 2]] - from);
                for (var of = 0; of < 3; of++)
                {
                    if (place.TryGetValue(around[corner + of], out var at)) normals[at] += normal;
                }
            }
            var first = vertices.Length - through.Count;
            for (var at = 0; at < through.Count; at++)
            {
                // Unity's own `normalized` takes what is as short as this for nothing.
                var normal = normals[at];
                var length = normal.magnitude;
                vertices[first + at] = vertices[through[at]] + (length > 0 ? heightM / length : 0) * normal;
            }
        }
    }
}
