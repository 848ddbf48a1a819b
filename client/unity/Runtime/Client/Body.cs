using System;
using System.Collections.Generic;
using Kerf.V1;

namespace Kerf.Client
{
    /// <summary>One object as a viewer has it: its lattice and the surface bound to it. Positions are metres in the scene
    /// frame, which is right-handed; see <see cref="Replica"/>.</summary>
    public sealed class Body
    {
        /// <summary>Most node slots of all objects together: 12 bytes for each are still one message.</summary>
        internal const uint MaxNodes = Assembler.MaxBytes / 12;

        const int Corners = 8;

        // Vertices are nodes themselves: SURFACE_ENCODING_VERTICES.
        readonly bool hasPlainVertices;

        // By node slot, three numbers each. Displacements in quanta.
        float[] restM = new float[0];
        long[] reference = new long[0];
        long[] displacement = new long[0];
        double quantumM;

        readonly Dictionary<uint, uint[]> elements = new Dictionary<uint, uint[]>();
        readonly Dictionary<uint, int> slotOfVertex = new Dictionary<uint, int>();
        readonly List<Vertex> vertices = new List<Vertex>();
        readonly Dictionary<uint, int> slotOfQuad = new Dictionary<uint, int>();
        readonly List<Quad> quads = new List<Quad>();
        readonly List<Adapted> adapted = new List<Adapted>();

        internal Body(bool hasPlainVertices)
        {
            this.hasPlainVertices = hasPlainVertices;
        }

        /// <summary>Vertices of the surface; those of a lower index never change their id.</summary>
        public int VertexCount => vertices.Count;

        /// <summary>Quads of the surface.</summary>
        public int QuadCount => quads.Count;

        /// <summary>Sum of the hashes of the vertices, weights and quads.</summary>
        internal ulong HashSum { get; private set; }

        struct Vertex
        {
            public uint Id, Element, Material;
            public float U, V, W;
            // How much each corner's displacement counts, where something is held nearby; else absent.
            public float[] Held;
        }

        struct Quad
        {
            public uint Id, A, B, C, D;
        }

        struct Adapted
        {
            public int Vertex;
            public float X, Y, Z;
        }

        /// <summary>Id of a vertex, as the server names it.</summary>
        public uint IdOf(int vertex) => vertices[vertex].Id;

        /// <summary>Material of a vertex, an index into ObjectSummary.material_names.</summary>
        public uint MaterialOf(int vertex) => vertices[vertex].Material;

        /// <summary>Whether a quad is a wall of a cut: the other side of its link is there too.</summary>
        public bool IsCutFace(int quad) => slotOfQuad.ContainsKey(quads[quad].Id ^ 1);

        /// <summary>Vertices of a quad, counter-clockwise seen from outside, split into two triangles along the diagonal
        /// from the first of them.</summary>
        public void Triangles(int quad, int[] into, int at)
        {
            var q = quads[quad];
            int a = slotOfVertex[q.A], b = slotOfVertex[q.B], c = slotOfVertex[q.C], d = slotOfVertex[q.D];
            into[at] = a;
            into[at + 1] = b;
            into[at + 2] = c;
            into[at + 3] = a;
            into[at + 4] = c;
            into[at + 5] = d;
        }

        /// <summary>Edges at which a wall of a cut meets the outside, two vertices each: a cut that has closed again shows
        /// nowhere else.</summary>
        public int[] Seam()
        {
            var walls = new HashSet<ulong>();
            for (var quad = 0; quad < quads.Count; quad++)
            {
                if (!IsCutFace(quad)) continue;
                for (var corner = 0; corner < 4; corner++) walls.Add(Edge(quads[quad], corner));
            }
            var seam = new List<int>();
            for (var quad = 0; quad < quads.Count && walls.Count > 0; quad++)
            {
                if (IsCutFace(quad)) continue;
                for (var corner = 0; corner < 4; corner++)
                {
                    var edge = Edge(quads[quad], corner);
                    if (!walls.Remove(edge)) continue;
                    seam.Add(slotOfVertex[(uint)(edge >> 32)]);
                    seam.Add(slotOfVertex[(uint)edge]);
                }
            }
            return seam.ToArray();
        }

        static ulong Edge(Quad quad, int corner)
        {
            var from = corner == 0 ? quad.A : corner == 1 ? quad.B : corner == 2 ? quad.C : quad.D;
            var to = corner == 0 ? quad.B : corner == 1 ? quad.C : corner == 2 ? quad.D : quad.A;
            return from < to ? (ulong)from << 32 | to : (ulong)to << 32 | from;
        }

        /// <summary>Where every vertex is now, m: x, y, z each.</summary>
        public void Positions(float[] intoM)
        {
            for (var index = 0; index < vertices.Count; index++) Position(vertices[index], intoM, 3 * index);
            foreach (var offset in adapted)
            {
                intoM[3 * offset.Vertex] += offset.X;
                intoM[3 * offset.Vertex + 1] += offset.Y;
                intoM[3 * offset.Vertex + 2] += offset.Z;
            }
        }

        void Position(Vertex vertex, float[] intoM, int at)
        {
            if (hasPlainVertices)
            {
                var of = 3 * (int)vertex.Id;
                for (var axis = 0; axis < 3; axis++) intoM[at + axis] = (float)(restM[of + axis] + quantumM * displacement[of + axis]);
                return;
            }
            var nodes = elements[vertex.Element];
            double x = 0, y = 0, z = 0;
            for (var corner = 0; corner < Corners; corner++)
            {
                var node = 3 * (int)nodes[corner];
                var rest = CornerWeight(corner, vertex);
                var moved = (vertex.Held == null ? rest : vertex.Held[corner]) * quantumM;
                x += rest * restM[node] + moved * displacement[node];
                y += rest * restM[node + 1] + moved * displacement[node + 1];
                z += rest * restM[node + 2] + moved * displacement[node + 2];
            }
            intoM[at] = (float)x;
            intoM[at + 1] = (float)y;
            intoM[at + 2] = (float)z;
        }

        static double CornerWeight(int corner, Vertex vertex)
        {
            return ((corner & 1) != 0 ? vertex.U : 1 - vertex.U)
                * ((corner & 2) != 0 ? vertex.V : 1 - vertex.V)
                * ((corner & 4) != 0 ? vertex.W : 1 - vertex.W);
        }

        /// <summary>Takes what a keyframe (into an empty body) or a patch says; <paramref name="room"/> is for how many node
        /// slots. After an exception the body is not to be used.</summary>
        internal void Change(BodyStructure change, uint room)
        {
            if (change.QuantumM > 0) quantumM = change.QuantumM;
            Need(quantumM > 0, "quantum_m", "a positive length");
            ChangeNodes(change, room);
            if (hasPlainVertices)
            {
                ChangePlainVertices(change);
            }
            else
            {
                ChangeElements(change);
                ChangeVertices(change);
            }
            ChangeQuads(change);
        }

        void ChangeNodes(BodyStructure change, uint room)
        {
            Need(change.NodeCount <= room, "node_count", "at most " + room);
            var numbers = 3 * (int)change.NodeCount;
            Need(numbers >= restM.Length, "node_count", "no fewer than before");
            Array.Resize(ref restM, numbers);
            Array.Resize(ref reference, numbers);
            Array.Resize(ref displacement, numbers);
            NeedCount("node_rest_m", change.NodeRestM.Count, 3 * change.NodeIds.Count);
            for (var i = 0; i < change.NodeIds.Count; i++)
            {
                var id = change.NodeIds[i];
                Need(id < change.NodeCount, "node_ids", "ids below node_count");
                for (var axis = 0; axis < 3; axis++) restM[3 * id + axis] = change.NodeRestM[3 * i + axis];
            }
        }

        void ChangeElements(BodyStructure change)
        {
            NeedCount("element_nodes", change.ElementNodes.Count, Corners * change.ElementIds.Count);
            for (var i = 0; i < change.ElementIds.Count; i++)
            {
                var nodes = new uint[Corners];
                for (var corner = 0; corner < Corners; corner++)
                {
                    nodes[corner] = change.ElementNodes[Corners * i + corner];
                    Need(nodes[corner] < change.NodeCount, "element_nodes", "ids below node_count");
                }
                elements[change.ElementIds[i]] = nodes;
            }
        }

        void ChangeVertices(BodyStructure change)
        {
            var count = change.VertexIds.Count;
            NeedCount("vertex_elements", change.VertexElements.Count, count);
            NeedCount("vertex_local", change.VertexLocal.Count, 3 * count);
            var hasMaterials = change.VertexMaterials.Count != 0;
            if (hasMaterials) NeedCount("vertex_materials", change.VertexMaterials.Count, count);
            var held = HeldWeights(change);
            for (var i = 0; i < count; i++)
            {
                var vertex = new Vertex
                {
                    Id = change.VertexIds[i],
                    Element = change.VertexElements[i],
                    Material = hasMaterials ? change.VertexMaterials[i] : 0,
                    U = change.VertexLocal[3 * i],
                    V = change.VertexLocal[3 * i + 1],
                    W = change.VertexLocal[3 * i + 2],
                };
                Need(elements.ContainsKey(vertex.Element), "vertex_elements", "ids of elements");
                held.TryGetValue(vertex.Id, out vertex.Held);
                var after = HashOf(vertex);
                if (slotOfVertex.TryGetValue(vertex.Id, out var slot))
                {
                    Exchange(HashOf(vertices[slot]), after);
                    vertices[slot] = vertex;
                }
                else
                {
                    Exchange(0, after);
                    slotOfVertex[vertex.Id] = vertices.Count;
                    vertices.Add(vertex);
                }
            }
        }

        void ChangePlainVertices(BodyStructure change)
        {
            var hasMaterials = change.VertexMaterials.Count != 0;
            if (hasMaterials) NeedCount("vertex_materials", change.VertexMaterials.Count, change.NodeIds.Count);
            for (var i = 0; i < change.NodeIds.Count; i++)
            {
                var vertex = new Vertex { Id = change.NodeIds[i], Material = hasMaterials ? change.VertexMaterials[i] : 0 };
                if (slotOfVertex.TryGetValue(vertex.Id, out var slot))
                {
                    vertices[slot] = vertex;
                }
                else
                {
                    slotOfVertex[vertex.Id] = vertices.Count;
                    vertices.Add(vertex);
                }
            }
        }

        static Dictionary<uint, float[]> HeldWeights(BodyStructure change)
        {
            NeedCount("held_vertex_weights", change.HeldVertexWeights.Count, Corners * change.HeldVertexIds.Count);
            var held = new Dictionary<uint, float[]>();
            for (var i = 0; i < change.HeldVertexIds.Count; i++)
            {
                var weights = new float[Corners];
                for (var corner = 0; corner < Corners; corner++) weights[corner] = change.HeldVertexWeights[Corners * i + corner];
                held[change.HeldVertexIds[i]] = weights;
            }
            return held;
        }

        void ChangeQuads(BodyStructure change)
        {
            NeedCount("quad_vertices", change.QuadVertices.Count, 4 * change.QuadIds.Count);
            for (var i = 0; i < change.QuadIds.Count; i++)
            {
                var of = change.QuadVertices;
                var quad = new Quad { Id = change.QuadIds[i], A = of[4 * i], B = of[4 * i + 1], C = of[4 * i + 2], D = of[4 * i + 3] };
                var known = slotOfVertex.ContainsKey(quad.A) && slotOfVertex.ContainsKey(quad.B)
                    && slotOfVertex.ContainsKey(quad.C) && slotOfVertex.ContainsKey(quad.D);
                Need(known, "quad_vertices", "ids of vertices");
                if (slotOfQuad.TryGetValue(quad.Id, out var slot))
                {
                    Exchange(HashOf(quads[slot]), HashOf(quad));
                    quads[slot] = quad;
                }
                else
                {
                    Exchange(0, HashOf(quad));
                    slotOfQuad[quad.Id] = quads.Count;
                    quads.Add(quad);
                }
            }
        }

        /// <summary>Takes where the object is.</summary>
        internal void Move(BodyState state, bool hasReference)
        {
            if (hasReference)
            {
                var given = Integers.Read("reference", state.Reference, reference);
                Array.Clear(reference, given, reference.Length - given);
            }
            NeedCount("displacements", Integers.Read("displacements", state.Displacements, displacement), displacement.Length);
            for (var i = 0; i < displacement.Length; i++) displacement[i] += reference[i];
            Adapt(state);
        }

        void Adapt(BodyState state)
        {
            adapted.Clear();
            if (state.AdaptedIds.IsEmpty) return;
            // An id takes a byte or more, but for zeros, which no second id adds: they ascend.
            var steps = new long[state.AdaptedIds.Length];
            var count = Integers.Read("adapted_ids", state.AdaptedIds, steps);
            var offsets = new long[3 * count];
            NeedCount("adapted_offsets", Integers.Read("adapted_offsets", state.AdaptedOffsets, offsets), offsets.Length);
            long id = 0;
            for (var i = 0; i < count; i++)
            {
                id += steps[i];
                Need(slotOfVertex.TryGetValue(unchecked((uint)id), out var vertex), "adapted_ids", "ids of vertices");
                adapted.Add(new Adapted
                {
                    Vertex = vertex,
                    X = (float)(offsets[3 * i] * quantumM),
                    Y = (float)(offsets[3 * i + 1] * quantumM),
                    Z = (float)(offsets[3 * i + 2] * quantumM),
                });
            }
        }

        void Exchange(ulong before, ulong after)
        {
            unchecked { HashSum = HashSum - before + after; }
        }

        static ulong HashOf(Vertex vertex)
        {
            var bound = SurfaceHash.OfVertex(vertex.Id, vertex.Element, vertex.U, vertex.V, vertex.W, vertex.Material);
            return vertex.Held == null ? bound : unchecked(bound + SurfaceHash.OfHeld(vertex.Id, vertex.Held));
        }

        static ulong HashOf(Quad quad) => SurfaceHash.OfQuad(quad.Id, quad.A, quad.B, quad.C, quad.D);

        static void NeedCount(string field, int got, int expected)
        {
            if (got != expected) throw new MalformedException(field, expected + " numbers, not " + got + ",");
        }

        static void Need(bool holds, string field, string expected)
        {
            if (!holds) throw new MalformedException(field, expected);
        }
    }
}
