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
        Mesh mesh;
        float[] positionsM = new float[0];
        Vector3[] vertices = new Vector3[0];
        int structure = -1;

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
            Resize(body.VertexCount);
            body.Positions(positionsM);
            for (var i = 0; i < vertices.Length; i++) vertices[i] = new Vector3(positionsM[3 * i], positionsM[3 * i + 1], -positionsM[3 * i + 2]);
            if (structure != structureCount) mesh.Clear();
            mesh.vertices = vertices;
            if (structure != structureCount)
            {
                structure = structureCount;
                mesh.subMeshCount = 3;
                mesh.SetTriangles(Triangles(body, false), 0, false);
                mesh.SetTriangles(Triangles(body, true), 1, false);
                mesh.SetIndices(body.Seam(), MeshTopology.Lines, 2, false);
            }
            mesh.RecalculateNormals();
            mesh.RecalculateBounds();
        }

        void Resize(int count)
        {
            if (vertices.Length == count) return;
            vertices = new Vector3[count];
            positionsM = new float[3 * count];
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
