using System;
using Kerf.Client;
using UnityEngine;
using UnityEngine.Rendering;

namespace Kerf.Unity
{
    /// <summary>Draws one object: a mesh whose first part is its outside, whose second the walls of its cuts, and whose
    /// third the lines where those meet.</summary>
    [RequireComponent(typeof(MeshFilter), typeof(MeshRenderer))]
    public sealed class KerfTissue : MonoBehaviour
    {
        readonly SeamLine line = new SeamLine();
        Mesh mesh;
        float[] positionsM = new float[0];
        Vector3[] vertices = new Vector3[0];
        int structure = -1;

        /// <summary>How far the lines stand out from the surface, m.</summary>
        public float SeamHeightM { get; set; } = 5e-4f;

        void Awake()
        {
            mesh = new Mesh { indexFormat = IndexFormat.UInt32 };
            mesh.MarkDynamic();
            GetComponent<MeshFilter>().sharedMesh = mesh;
        }

        void OnDestroy() => Destroy(mesh);

        /// <summary>Materials of the outside, of the walls of cuts and of their seams.</summary>
        public void SetMaterials(Material skin, Material cutFace, Material seam)
        {
            GetComponent<MeshRenderer>().sharedMaterials = new[] { skin, cutFace, seam };
        }

        /// <summary>Takes over where the object is; its triangles are made anew where the structure is.</summary>
        public void Show(Body body, int structureCount)
        {
            var isNew = structure != structureCount;
            int[] outside = null, lines = null;
            if (isNew)
            {
                structure = structureCount;
                outside = Triangles(body, false);
                lines = line.Restructure(body.Seam(), outside, body.VertexCount);
                mesh.Clear();
            }
            Place(body);
            mesh.vertices = vertices;
            if (isNew)
            {
                mesh.subMeshCount = 3;
                mesh.SetTriangles(outside, 0, false);
                mesh.SetTriangles(Triangles(body, true), 1, false);
                mesh.SetIndices(lines, MeshTopology.Lines, 2, false);
            }
            mesh.RecalculateNormals();
            mesh.RecalculateBounds();
        }

        void Place(Body body)
        {
            var count = body.VertexCount;
            if (vertices.Length != count + line.Count) vertices = new Vector3[count + line.Count];
            if (positionsM.Length != 3 * count) positionsM = new float[3 * count];
            body.Positions(positionsM);
            for (var i = 0; i < count; i++) vertices[i] = new Vector3(positionsM[3 * i], positionsM[3 * i + 1], -positionsM[3 * i + 2]);
            line.Raise(vertices, SeamHeightM);
        }

        static int[] Triangles(Body body, bool cutFaces)
        {
            var triangles = new int[6 * body.QuadCount];
            var end = 0;
            for (var quad = 0; quad < body.QuadCount; quad++)
            {
                if (body.IsCutFace(quad) != cutFaces) continue;
                body.Triangles(quad, triangles, end);
                // Mirrored, they are seen from the other side.
                Array.Reverse(triangles, end, 3);
                Array.Reverse(triangles, end + 3, 3);
                end += 6;
            }
            Array.Resize(ref triangles, end);
            return triangles;
        }
    }
}
