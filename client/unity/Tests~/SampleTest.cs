using System;
using System.Diagnostics;
using System.IO;
using System.Linq;
using System.Threading;
using Kerf.Client;
using Kerf.Unity;
using UnityEngine;

/// <summary>Plays the sample a frame at a time against a server that runs: SampleTest ADDRESS PACKAGE. Ends with 0 where all
/// holds.</summary>
static class SampleTest
{
    const float FrameS = 1 / 60f;
    /// <summary>Gc times the width of the blade, N: what a steady cut of `cuboid` takes.</summary>
    const float TheoryN = 1100 * 0.06f;

    static void Main(string[] arguments)
    {
        Resources.Folder = arguments[1] + "/Runtime/Resources";
        FieldsMayBeSetAfterTheComponentIsThere(arguments[0]);
        TheSampleCuts(arguments[0]);
        var made = TheMenuMakesASessionWithABlade();
        ThePrefabIsWhatTheMenuMakes(arguments[0], arguments[1], made);
        End.Now();
    }

    static void FieldsMayBeSetAfterTheComponentIsThere(string address)
    {
        var session = new GameObject("nowhere").AddComponent<KerfSession>();
        session.address = address;
        session.sessionId = "nobody";
        PlayUntil("a word of the session that is not there", () => session.Trouble != null);
        Expect(session.Trouble.Contains("nobody"), session.Trouble);
        UnityEngine.Object.Destroy(session.gameObject);
        Console.WriteLine("ok FieldsMayBeSetAfterTheComponentIsThere");
    }

    static void TheSampleCuts(string address)
    {
        var sample = new GameObject("Sample").AddComponent<CutSample>();
        sample.address = address;
        sample.sceneName = "cuboid";
        Point(Camera.Width / 2, Camera.Height / 2);
        GameObject.Frame(FrameS);
        var session = sample.GetComponent<KerfSession>();
        var handle = GameObject.Find("Blade");
        var blade = handle.GetComponent<KerfTool>();
        session.stepRateHz = 125;
        PlayUntil("a first state", () => session.State != null);
        Expect(GUI.Said.Contains("height 100 mm"), GUI.Said);

        // Where the mouse is, at the height that is said: the eye looks down at the middle from z = -0.35 m.
        PlayUntil("the blade under the mouse", () => Near(handle.transform.position.z, -0.1f));
        Expect(Near(handle.transform.position.x, 0), "x is " + handle.transform.position.x);
        Expect(Near(handle.transform.position.y, 0.1f), "y is " + handle.transform.position.y);
        Point(0.6f * Camera.Width, Camera.Height / 2);
        PlayUntil("the blade to the right", () => handle.transform.position.x > 0.02f);
        // Over the middle of the block.
        PointOver(0.1f);
        Play(1);

        var body = GameObject.Find("cuboid");
        var mesh = body.GetComponent<MeshFilter>().sharedMesh;
        var materials = body.GetComponent<MeshRenderer>().sharedMaterials;
        Expect(materials.Length == 3 && materials.All(material => material), "a part of the tissue has no material");
        Expect(mesh.vertices.Length > 1000 && mesh.GetIndices(0).Length > 1000, "there is no tissue");
        Expect(mesh.GetIndices(1).Length == 0 && mesh.GetIndices(2).Length == 0, "it is cut before it is touched");

        // Down by notches of the wheel, until the edge is well in; then evenly through what is below.
        var steadyN = Array.Empty<float>();
        for (var notch = 0; notch < 8; notch++)
        {
            Notch(1);
            PointOver(0.09f - 0.01f * notch);
            for (var clock = Stopwatch.StartNew(); clock.Elapsed.TotalSeconds < 0.4;)
            {
                Play(FrameS);
                // In the tissue with all of the edge: half of it is not.
                if (blade.ForceN.y > 0.6f * TheoryN) steadyN = steadyN.Append(blade.ForceN.y).ToArray();
            }
        }
        Expect(session.Trouble == null, session.Trouble);
        Expect(mesh.GetIndices(1).Length > 100, "no wall of a cut is drawn");
        Expect(mesh.GetIndices(2).Length > 20, "no seam is drawn");
        ExpectRaised(mesh, 0.004f * Extent(mesh).magnitude);
        Expect(steadyN.Length > 10, "the edge did not cut");
        var meanN = steadyN.OrderBy(force => force).ElementAt(steadyN.Length / 2);
        Expect(Math.Abs(meanN / TheoryN - 1) < 0.05f, "a steady cut takes " + meanN + " N, not " + TheoryN);

        var server = new Server(address);
        Expect(server.ListSessions().Count == 1, "its session is not there");
        UnityEngine.Object.Destroy(sample.gameObject);
        Expect(server.ListSessions().Count == 0, "its session is still there");
        Console.WriteLine("ok TheSampleCuts: " + meanN.ToString("0.0") + " N, theory " + TheoryN);
    }

    static GameObject TheMenuMakesASessionWithABlade()
    {
        KerfMenu.AddSession();
        var session = UnityEditor.Selection.activeGameObject.GetComponent<KerfSession>();
        Expect(session, "what it made is not selected");
        var blades = session.transform.Children.Select(child => child.gameObject.GetComponent<KerfTool>()).ToArray();
        Expect(blades.Length == 1 && blades[0].session == session, "there is no blade of that session");
        Console.WriteLine("ok TheMenuMakesASessionWithABlade");
        return session.gameObject;
    }

    static void ThePrefabIsWhatTheMenuMakes(string address, string package, GameObject made)
    {
        var root = new Prefab(package, package + "/Runtime/Prefabs/Kerf.prefab").Instantiate();
        ExpectSame(root, made, "");
        UnityEngine.Object.Destroy(made);
        // It plays.
        var session = root.GetComponent<KerfSession>();
        session.address = address;
        session.sceneName = "cuboid";
        PlayUntil("a state of the prefab's session", () => session.State != null || session.Trouble != null);
        Expect(session.Trouble == null, session.Trouble);
        UnityEngine.Object.Destroy(root);
        Console.WriteLine("ok ThePrefabIsWhatTheMenuMakes");
    }

    static void ExpectSame(GameObject one, GameObject other, string above)
    {
        var name = above + "/" + one.name;
        Expect(one.name == other.name, name + " is " + other.name);
        var (a, b) = (one.transform, other.transform);
        Expect((a.localPosition - b.localPosition).magnitude < 1e-6f, name + " is elsewhere");
        Expect((a.localScale - b.localScale).magnitude < 1e-6f, name + " is of another size");
        var (parts, others) = (one.GetComponents<Component>(), other.GetComponents<Component>());
        Expect(parts.Select(part => part.GetType()).SequenceEqual(others.Select(part => part.GetType())), name + " has other components");
        for (var part = 0; part < parts.Length; part++)
        {
            foreach (var field in Prefab.Fields(parts[part].GetType()).Where(_ => parts[part] is MonoBehaviour))
            {
                var (value, expected) = (field.GetValue(parts[part]), field.GetValue(others[part]));
                // Of a reference the object that it is on: there are two of each.
                if (value is Component from && expected is Component to) (value, expected) = (from.gameObject.name, to.gameObject.name);
                Expect(Equals(value, expected), name + "." + field.Name + " is " + value + ", not " + expected);
            }
        }
        var (children, those) = (a.Children.ToArray(), b.Children.ToArray());
        Expect(children.Length == those.Length, name + " has other children");
        for (var child = 0; child < children.Length; child++) ExpectSame(children[child].gameObject, those[child].gameObject, name);
    }

    /// <summary>The seam on vertices of its own, which stand out from those of the surface by the height.</summary>
    static void ExpectRaised(Mesh mesh, float heightM)
    {
        var surface = mesh.GetIndices(0).Concat(mesh.GetIndices(1)).Distinct().Select(index => mesh.vertices[index]).ToArray();
        var middle = 1f / surface.Length * surface.Aggregate((sum, vertex) => sum + vertex);
        var raised = mesh.GetIndices(2).Distinct().Select(index => mesh.vertices[index]).ToArray();
        var ways = raised.Select(at => at - surface.OrderBy(vertex => (vertex - at).magnitude).First()).ToArray();
        Expect(ways.All(way => way.magnitude < 1.1f * heightM), "a line floats at " + ways.Max(way => way.magnitude) + " m, not " + heightM);
        Expect(ways.Count(way => way.magnitude > 0.5f * heightM) > 0.9 * ways.Length, "lines are in the surface");
        var outward = raised.Where((at, index) => Vector3.Dot(ways[index], at - middle) > 0);
        Expect(outward.Count() > 0.9 * raised.Length, "lines are raised into the tissue: " + outward.Count() + " of " + raised.Length);
    }

    /// <summary>From one corner of the box around the outside to the other: the tissue's size at rest is hardly another.</summary>
    static Vector3 Extent(Mesh mesh)
    {
        var outside = mesh.GetIndices(0).Select(index => mesh.vertices[index]).ToArray();
        return new Vector3(
            outside.Max(at => at.x) - outside.Min(at => at.x), outside.Max(at => at.y) - outside.Min(at => at.y), outside.Max(at => at.z) - outside.Min(at => at.z));
    }

    /// <summary>The mouse where the vertical axis is at a height: the eye is at 0.35 m of height and before it.</summary>
    static void PointOver(float heightM)
    {
        var aboveMiddle = Math.PI / 4 - Math.Atan((0.35 - heightM) / 0.35);
        var share = Math.Tan(aboveMiddle) / Math.Tan(Camera.FieldOfViewDeg * Math.PI / 360);
        Point(Camera.Width / 2, (float)(0.5 + 0.5 * share) * Camera.Height);
    }

    static void Point(float x, float y)
    {
        Input.mousePosition = new Vector3(x, y, 0);
        if (UnityEngine.InputSystem.Mouse.current == null) UnityEngine.InputSystem.Mouse.current = new UnityEngine.InputSystem.Mouse();
        UnityEngine.InputSystem.Mouse.current.position.Value = new Vector2(x, y);
    }

    /// <summary>The wheel turned by a notch in one frame.</summary>
    static void Notch(float by)
    {
        Input.mouseScrollDelta = new Vector2(0, by);
        UnityEngine.InputSystem.Mouse.current.scroll.Value = new Vector2(0, 120 * by);
        GameObject.Frame(FrameS);
        Input.mouseScrollDelta = new Vector2();
        UnityEngine.InputSystem.Mouse.current.scroll.Value = new Vector2();
    }

    static void Play(float seconds)
    {
        for (var frame = 0; frame < seconds / FrameS; frame++)
        {
            GameObject.Frame(FrameS);
            Thread.Sleep(TimeSpan.FromSeconds(FrameS));
        }
    }

    static void PlayUntil(string what, Func<bool> holds)
    {
        var clock = Stopwatch.StartNew();
        while (!holds())
        {
            Expect(clock.Elapsed.TotalSeconds < 60, "played in vain for " + what);
            Play(FrameS);
        }
    }

    static bool Near(float value, float expected) => Math.Abs(value - expected) < 1e-3f;

    static void Expect(bool holds, string otherwise)
    {
        if (!holds) throw new Exception(otherwise);
    }
}
