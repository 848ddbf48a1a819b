// As much of Unity's types as the package and its sample use: enough to compile them, and to let the sample run a frame at a
// time without the editor. Used by the tests alone. What they do is what Unity's manual says of the members here.

using System;
using System.Collections.Generic;
using System.Reflection;

namespace UnityEngine
{
    public struct Vector2
    {
        public float x, y;

        public Vector2(float x, float y)
        {
            this.x = x;
            this.y = y;
        }

        public static implicit operator Vector3(Vector2 v) => new Vector3(v.x, v.y, 0);
    }

    public struct Vector3
    {
        public float x, y, z;

        public Vector3(float x, float y, float z)
        {
            this.x = x;
            this.y = y;
            this.z = z;
        }

        public static Vector3 zero => new Vector3();
        public static Vector3 one => new Vector3(1, 1, 1);
        public static Vector3 up => new Vector3(0, 1, 0);
        public static Vector3 forward => new Vector3(0, 0, 1);

        public float magnitude => (float)Math.Sqrt(Dot(this, this));
        public Vector3 normalized => magnitude > 1e-5f ? 1 / magnitude * this : zero;

        public static float Dot(Vector3 a, Vector3 b) => a.x * b.x + a.y * b.y + a.z * b.z;
        public static Vector3 Cross(Vector3 a, Vector3 b) => new Vector3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
        public static Vector3 Scale(Vector3 a, Vector3 b) => new Vector3(a.x * b.x, a.y * b.y, a.z * b.z);

        public static Vector3 MoveTowards(Vector3 from, Vector3 to, float by)
        {
            var way = to - from;
            return way.magnitude <= by ? to : from + by / way.magnitude * way;
        }

        public static Vector3 operator +(Vector3 a, Vector3 b) => new Vector3(a.x + b.x, a.y + b.y, a.z + b.z);
        public static Vector3 operator -(Vector3 a, Vector3 b) => new Vector3(a.x - b.x, a.y - b.y, a.z - b.z);
        public static Vector3 operator -(Vector3 a) => new Vector3(-a.x, -a.y, -a.z);
        public static Vector3 operator *(float s, Vector3 v) => new Vector3(s * v.x, s * v.y, s * v.z);
        public static Vector3 operator *(Vector3 v, float s) => s * v;
    }

    public struct Quaternion
    {
        public float x, y, z, w;

        public Quaternion(float x, float y, float z, float w)
        {
            this.x = x;
            this.y = y;
            this.z = z;
            this.w = w;
        }

        public static Quaternion identity => new Quaternion(0, 0, 0, 1);

        public static Quaternion AngleAxis(float degrees, Vector3 axis)
        {
            var half = degrees * Math.PI / 360;
            var v = (float)Math.Sin(half) * axis.normalized;
            return new Quaternion(v.x, v.y, v.z, (float)Math.Cos(half));
        }

        // About z, then x, then y.
        public static Quaternion Euler(float x, float y, float z)
        {
            return AngleAxis(y, Vector3.up) * AngleAxis(x, new Vector3(1, 0, 0)) * AngleAxis(z, Vector3.forward);
        }

        public static Quaternion LookRotation(Vector3 forward)
        {
            var pitch = Math.Atan2(-forward.y, Math.Sqrt(forward.x * forward.x + forward.z * forward.z));
            return Euler((float)(pitch * 180 / Math.PI), (float)(Math.Atan2(forward.x, forward.z) * 180 / Math.PI), 0);
        }

        public static Quaternion Inverse(Quaternion q) => new Quaternion(-q.x, -q.y, -q.z, q.w);

        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(
                a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
                a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }

        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            var axis = new Vector3(q.x, q.y, q.z);
            var t = 2 * Vector3.Cross(axis, v);
            return v + q.w * t + Vector3.Cross(axis, t);
        }
    }

    public struct Ray
    {
        public Vector3 origin, direction;

        public Ray(Vector3 origin, Vector3 direction)
        {
            this.origin = origin;
            this.direction = direction.normalized;
        }

        public Vector3 GetPoint(float along) => origin + along * direction;
    }

    public struct Plane
    {
        public Vector3 normal;
        public float distance;

        public Plane(Vector3 normal, Vector3 point)
        {
            this.normal = normal.normalized;
            distance = -Vector3.Dot(this.normal, point);
        }

        public bool Raycast(Ray ray, out float along)
        {
            var towards = Vector3.Dot(ray.direction, normal);
            along = Math.Abs(towards) < 1e-6f ? 0 : (-Vector3.Dot(ray.origin, normal) - distance) / towards;
            return along > 0;
        }
    }

    public struct Rect
    {
        public Rect(float x, float y, float width, float height)
        {
        }
    }

    public struct Color
    {
        public float r, g, b, a;

        public Color(float r, float g, float b, float a = 1)
        {
            this.r = r;
            this.g = g;
            this.b = b;
            this.a = a;
        }
    }

    public static class Mathf
    {
        public static float Clamp(float value, float least, float most) => Math.Max(least, Math.Min(most, value));
    }

    public static class Time
    {
        public static float deltaTime { get; internal set; }
    }

    public static class Input
    {
        public static Vector3 mousePosition { get; set; }
        public static Vector2 mouseScrollDelta { get; set; }
    }

    public static class GUI
    {
        /// <summary>What was written last; the tests read it.</summary>
        public static string Said { get; private set; }

        public static void Label(Rect at, string text) => Said = text;
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class TooltipAttribute : Attribute
    {
        public TooltipAttribute(string text)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class RangeAttribute : Attribute
    {
        public RangeAttribute(float least, float most)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class RequireComponent : Attribute
    {
        public RequireComponent(Type one)
        {
        }

        public RequireComponent(Type one, Type other)
        {
        }
    }

    [AttributeUsage(AttributeTargets.Class)]
    public sealed class ExecuteAlways : Attribute
    {
    }

    [AttributeUsage(AttributeTargets.Field)]
    public sealed class SerializeField : Attribute
    {
    }

    public class Object
    {
        public string name = "";
        bool isDestroyed;

        public static implicit operator bool(Object of) => of is object && !of.isDestroyed;

        public static void DestroyImmediate(Object what) => Destroy(what);

        public static void Destroy(Object what)
        {
            if (!what) return;
            if (what is GameObject made) made.End();
            if (what is Component part) part.gameObject.Remove(part);
            what.isDestroyed = true;
        }
    }

    public class Component : Object
    {
        public GameObject gameObject { get; internal set; }
        public Transform transform => gameObject.transform;

        public T GetComponent<T>() where T : Component => gameObject.GetComponent<T>();
    }

    public class MonoBehaviour : Component
    {
        internal bool HasStarted;
    }

    public sealed class Transform : Component
    {
        readonly List<Transform> children = new List<Transform>();
        Transform parent;

        public Vector3 localPosition { get; set; }
        public Quaternion localRotation { get; set; } = Quaternion.identity;
        public Vector3 localScale { get; set; } = Vector3.one;
        public IEnumerable<Transform> Children => children.ToArray();

        public Vector3 position
        {
            get => parent ? parent.TransformPoint(localPosition) : localPosition;
            set => localPosition = parent ? parent.InverseTransformPoint(value) : value;
        }

        public Quaternion rotation
        {
            get => parent ? parent.rotation * localRotation : localRotation;
            set => localRotation = parent ? Quaternion.Inverse(parent.rotation) * value : value;
        }

        public void SetParent(Transform to, bool keepsPlace)
        {
            var (at, turned) = (position, rotation);
            if (parent) parent.children.Remove(this);
            parent = to;
            to.children.Add(this);
            if (keepsPlace) (position, rotation) = (at, turned);
        }

        public void LookAt(Vector3 at) => rotation = Quaternion.LookRotation(at - position);

        // Nobody here scales what has children that move.
        public Vector3 TransformPoint(Vector3 local) => position + rotation * Vector3.Scale(localScale, local);

        public Vector3 InverseTransformPoint(Vector3 at)
        {
            var local = Quaternion.Inverse(rotation) * (at - position);
            return new Vector3(local.x / localScale.x, local.y / localScale.y, local.z / localScale.z);
        }

        public Vector3 TransformDirection(Vector3 local) => rotation * local;
    }

    public sealed class GameObject : Object
    {
        static readonly List<GameObject> all = new List<GameObject>();
        readonly List<Component> parts = new List<Component>();

        public Transform transform { get; }

        public GameObject(string name, params Type[] parts)
        {
            this.name = name;
            transform = new Transform { gameObject = this };
            all.Add(this);
            foreach (var part in parts) Add(part);
        }

        public static GameObject CreatePrimitive(PrimitiveType type)
        {
            return new GameObject(type.ToString(), typeof(MeshFilter), typeof(MeshRenderer), typeof(Collider));
        }

        public static GameObject Find(string name) => all.Find(made => made.name == name);

        public T AddComponent<T>() where T : Component => (T)Add(typeof(T));

        public Component AddComponent(Type type) => Add(type);

        public T[] GetComponents<T>() where T : Component => parts.FindAll(part => part is T).ConvertAll(part => (T)part).ToArray();

        public T GetComponent<T>() where T : Component => (T)parts.Find(part => part is T);

        // What Unity calls of a behaviour that comes on while the game runs, before AddComponent returns.
        Component Add(Type type)
        {
            var part = (Component)Activator.CreateInstance(type);
            part.gameObject = this;
            parts.Add(part);
            Call(part, "Awake");
            Call(part, "OnEnable");
            return part;
        }

        internal void Remove(Component part)
        {
            parts.Remove(part);
            Call(part, "OnDisable");
            Call(part, "OnDestroy");
        }

        internal void End()
        {
            foreach (var child in transform.Children) Destroy(child.gameObject);
            foreach (var part in parts.ToArray()) Remove(part);
            all.Remove(this);
        }

        /// <summary>A frame of the game: starts what is new, updates everything, draws what is written.</summary>
        public static void Frame(float deltaS)
        {
            Time.deltaTime = deltaS;
            Each("Start", behaviour => !behaviour.HasStarted);
            Each("Update", _ => true);
            Each("OnGUI", _ => true);
        }

        static void Each(string what, Func<MonoBehaviour, bool> holds)
        {
            foreach (var made in all.ToArray())
            {
                foreach (var part in made.parts.ToArray())
                {
                    if (!(part is MonoBehaviour behaviour) || !holds(behaviour)) continue;
                    behaviour.HasStarted = true;
                    Call(behaviour, what);
                }
            }
        }

        static void Call(Component part, string what)
        {
            const BindingFlags any = BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic;
            try
            {
                if (part is MonoBehaviour) part.GetType().GetMethod(what, any)?.Invoke(part, null);
            }
            catch (TargetInvocationException error)
            {
                throw error.InnerException;
            }
        }
    }

    public enum PrimitiveType
    {
        Cube = 3,
    }

    public enum LightType
    {
        Directional = 1,
    }

    public sealed class Collider : Component
    {
    }

    public sealed class Light : Component
    {
        public LightType type { get; set; }
    }

    public sealed class Camera : Component
    {
        public const float Width = 1280, Height = 720, FieldOfViewDeg = 60;

        public float nearClipPlane { get; set; }

        public Ray ScreenPointToRay(Vector3 at)
        {
            var half = (float)Math.Tan(FieldOfViewDeg * Math.PI / 360);
            var x = (2 * at.x / Width - 1) * half * Width / Height;
            var y = (2 * at.y / Height - 1) * half;
            return new Ray(transform.position, transform.rotation * new Vector3(x, y, 1));
        }
    }

    public sealed class Material : Object
    {
    }

    public static class Resources
    {
        /// <summary>The package's folder; the tests set it. What is not there is not loaded, as in Unity.</summary>
        public static string Folder { get; set; } = "";

        public static T Load<T>(string path) where T : Object, new()
        {
            return System.IO.File.Exists(Folder + "/" + path + ".mat") ? new T { name = path } : null;
        }
    }

    public sealed class MeshFilter : Component
    {
        public Mesh sharedMesh { get; set; }
    }

    public sealed class MeshRenderer : Component
    {
        public Material sharedMaterial { get; set; }
        public Material[] sharedMaterials { get; set; }
    }

    public enum MeshTopology
    {
        Triangles = 0,
        Lines = 3,
    }

    public sealed class Mesh : Object
    {
        readonly Dictionary<int, int[]> parts = new Dictionary<int, int[]>();

        public Rendering.IndexFormat indexFormat { get; set; }
        public Vector3[] vertices { get; set; } = new Vector3[0];
        public int subMeshCount { get; set; } = 1;

        public void MarkDynamic()
        {
        }

        public void Clear() => parts.Clear();

        public void SetTriangles(int[] triangles, int part, bool calculatesBounds) => Set(triangles, part, 3);

        public void SetIndices(int[] indices, MeshTopology topology, int part, bool calculatesBounds)
        {
            Set(indices, part, topology == MeshTopology.Lines ? 2 : 3);
        }

        public int[] GetIndices(int part) => parts[part];

        public void RecalculateNormals()
        {
        }

        public void RecalculateBounds()
        {
        }

        void Set(int[] indices, int part, int each)
        {
            if (part >= subMeshCount) throw new IndexOutOfRangeException("sub-mesh " + part + " of " + subMeshCount);
            if (indices.Length % each != 0) throw new ArgumentException(indices.Length + " indices");
            foreach (var index in indices)
            {
                if (index < 0 || index >= vertices.Length) throw new IndexOutOfRangeException("vertex " + index);
            }
            parts[part] = indices;
        }
    }
}

namespace UnityEngine.Rendering
{
    public enum IndexFormat
    {
        UInt16 = 0,
        UInt32 = 1,
    }

    public sealed class RenderPipelineAsset : Object
    {
    }

    public static class GraphicsSettings
    {
        public static RenderPipelineAsset currentRenderPipeline { get; set; }
    }
}

namespace UnityEngine.InputSystem
{
    public sealed class Control<T>
    {
        public T Value;

        public T ReadValue() => Value;
    }

    public sealed class Mouse
    {
        public static Mouse current { get; set; }
        public Control<Vector2> position { get; } = new Control<Vector2>();
        public Control<Vector2> scroll { get; } = new Control<Vector2>();
    }
}

namespace UnityEditor
{
    [AttributeUsage(AttributeTargets.Method)]
    public sealed class MenuItem : Attribute
    {
        public MenuItem(string path, bool validates, int place)
        {
        }
    }

    public static class Undo
    {
        public static void RegisterCreatedObjectUndo(UnityEngine.Object made, string name)
        {
        }
    }

    public static class Selection
    {
        public static UnityEngine.GameObject activeGameObject { get; set; }
    }
}
