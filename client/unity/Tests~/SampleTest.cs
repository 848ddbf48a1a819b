using System;
using System.Diagnostics;
using System.IO;
using System.Linq;
using System.Threading;
using Kerf.Client;
using Kerf.Unity;
using UnityEngine;

/// <summary>Plays the sample a frame at a time against a server that runs: SampleTest ADDRESS RESOURCES. Ends with 0 where all
/// holds.</summary>
static class SampleTest
{
    const float FrameS = 1 / 60f;
    /// <summary>Gc times the width of the blade, N: what a steady cut of `cuboid` takes.</summary>
    const float TheoryN = 1100 * 0.06f;

    static int Main(string[] arguments)
    {
        Resources.Folder = arguments[1];
        FieldsMayBeSetAfterTheComponentIsThere(arguments[0]);
        TheSampleCuts(arguments[0]);
        TheMenuMakesASessionWithABlade();
        return 0;
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
        Expect(steadyN.Length > 10, "the edge did not cut");
        var meanN = steadyN.OrderBy(force => force).ElementAt(steadyN.Length / 2);
        Expect(Math.Abs(meanN / TheoryN - 1) < 0.05f, "a steady cut takes " + meanN + " N, not " + TheoryN);

        var server = new Server(address);
        Expect(server.ListSessions().Count == 1, "its session is not there");
        UnityEngine.Object.Destroy(sample.gameObject);
        Expect(server.ListSessions().Count == 0, "its session is still there");
        Console.WriteLine("ok TheSampleCuts: " + meanN.ToString("0.0") + " N, theory " + TheoryN);
    }

    static void TheMenuMakesASessionWithABlade()
    {
        KerfMenu.AddSession();
        var session = UnityEditor.Selection.activeGameObject.GetComponent<KerfSession>();
        Expect(session, "what it made is not selected");
        var blades = session.transform.Children.Select(child => child.gameObject.GetComponent<KerfTool>()).ToArray();
        Expect(blades.Length == 1 && blades[0].session == session, "there is no blade of that session");
        Console.WriteLine("ok TheMenuMakesASessionWithABlade");
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
