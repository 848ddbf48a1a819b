using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Threading;
using Google.Protobuf;
using Kerf.Client;
using Kerf.V1;

/// <summary>Tries the package's pure part against a server that runs. Ends with 0 where all holds.</summary>
static class LiveTest
{
    static Server server;

    static void Main(string[] arguments)
    {
        server = new Server(arguments[0]);
        var token = File.ReadAllText(arguments[2]).Trim();
        var tests = new Dictionary<string, Action>
        {
            [nameof(AnUnknownSessionIsRefusedInWords)] = AnUnknownSessionIsRefusedInWords,
            [nameof(APoseThatIsNoNumberIsRefusedByItsField)] = APoseThatIsNoNumberIsRefusedByItsField,
            [nameof(ABladeCutsAndTheSurfaceStaysTheServers)] = ABladeCutsAndTheSurfaceStaysTheServers,
            [nameof(ALateViewerSeesWhatAnEarlyOneDoes)] = ALateViewerSeesWhatAnEarlyOneDoes,
            [nameof(AViewerHearsOfTheEnd)] = AViewerHearsOfTheEnd,
            [nameof(NoServerIsSaidInWords)] = NoServerIsSaidInWords,
            [nameof(ASessionThatIsMadeSaysHowFarItIs)] = ASessionThatIsMadeSaysHowFarItIs,
            [nameof(AViewerAndADriverFollowASessionThatMoves)] =
                () => AViewerAndADriverFollowASessionThatMoves(arguments[0], arguments[5], arguments[6]),
            [nameof(ATokenOverTlsLetsIn)] = () => ATokenOverTlsLetsIn(arguments[1], token, arguments[3]),
        };
        AnAuthorityVouchesForServersOfItsNamesAlone(token, arguments[4]);
        for (var i = 7; i < arguments.Length; i += 2) ARecordedStreamIsDecodedAsItIsWrittenDown(arguments[i], arguments[i + 1]);
        FragmentsWithoutEndAreRefused();
        foreach (var test in tests)
        {
            test.Value();
            Console.WriteLine("ok " + test.Key);
        }
        End.Now();
    }

    /// <summary>proto/vectors: the stream, and lines of what is shown after each message: hash, or object, id and position.</summary>
    static void ARecordedStreamIsDecodedAsItIsWrittenDown(string stream, string expected)
    {
        var lines = new Queue<string[]>(File.ReadAllLines(expected).Select(line => line.Split(' ')));
        var bytes = File.ReadAllBytes(stream);
        var assembler = new Assembler();
        var replica = new Replica();
        for (var at = 0; at < bytes.Length;)
        {
            var length = BitConverter.ToInt32(bytes, at);
            var message = assembler.Take(ViewResponse.Parser.ParseFrom(bytes, at + 4, length));
            at += 4 + length;
            if (message == null) continue;
            replica.Take(message);
            for (var more = int.Parse(lines.Dequeue()[0]); more > 0; more--) ExpectShown(replica, lines.Dequeue());
        }
        Expect(lines.Count == 0, "messages are missing");
        Console.WriteLine("ok ARecordedStreamIsDecodedAsItIsWrittenDown " + Path.GetFileName(stream));
    }

    static void FragmentsWithoutEndAreRefused()
    {
        var assembler = new Assembler();
        var data = ByteString.CopyFrom(new byte[1 << 20]);
        try
        {
            for (var remaining = 1000u; remaining > 0; remaining--)
                assembler.Take(new ViewResponse { Fragment = new Fragment { Data = data, Remaining = remaining } });
        }
        catch (MalformedException error)
        {
            Expect(error.Message.Contains("fragment.data"), error.Message);
            Console.WriteLine("ok FragmentsWithoutEndAreRefused");
            return;
        }
        Expect(false, "a gigabyte was taken");
    }

    static void ExpectShown(Replica replica, string[] line)
    {
        if (line.Length == 1)
        {
            Expect(replica.Hash().ToString("x16") == line[0], "the surface is not " + line[0]);
            return;
        }
        var body = replica.Bodies[int.Parse(line[0])];
        var positions = new float[3 * body.VertexCount];
        body.Positions(positions);
        var index = Enumerable.Range(0, body.VertexCount).Single(i => body.IdOf(i) == uint.Parse(line[1]));
        for (var axis = 0; axis < 3; axis++)
        {
            var apart = Math.Abs(positions[3 * index + axis] - double.Parse(line[2 + axis], CultureInfo.InvariantCulture));
            Expect(apart < 1e-7, "vertex " + line[1] + " is " + apart + " m away");
        }
    }

    static void AnUnknownSessionIsRefusedInWords()
    {
        try
        {
            server.Describe("nobody");
        }
        catch (KerfException error)
        {
            Expect(error.Code == StatusCode.NotFound && error.Message.Contains("nobody"), error.Code + ": " + error.Message);
            return;
        }
        throw new Exception("an unknown session was described");
    }

    static void APoseThatIsNoNumberIsRefusedByItsField()
    {
        using (var session = new Session())
        using (var driver = new Driver(server, session.Id))
        {
            driver.Move(0, new Vec3 { X = float.NaN }, new Quat { W = 1 });
            Wait("a word", () => driver.Trouble != null);
            Expect(driver.Trouble.StartsWith("pose.position_m: finite"), driver.Trouble);
        }
    }

    static void ABladeCutsAndTheSurfaceStaysTheServers()
    {
        using (var session = new Session())
        using (var viewer = new Viewer(server, session.Id))
        using (var driver = new Driver(server, session.Id))
        {
            var box = session.Description.Scene.Objects[0];
            var seen = new Seen();
            Wait("a first surface", () => { viewer.Look(seen.Take); return seen.ById.Count > 0; });
            Expect(!seen.IsCut, "a wall of a cut before there is one");
            foreach (var position in seen.ById.Values) ExpectInside(position, box, 1e-3f);
            CutThrough(driver, box, () => viewer.Look(seen.Take));
            Wait("walls of a cut", () => { viewer.Look(seen.Take); return seen.IsCut; });
            foreach (var position in seen.ById.Values) ExpectInside(position, box, 0.05f);
            Expect(driver.Trouble == null, driver.Trouble);
            Expect(viewer.Trouble == null, viewer.Trouble);
        }
    }

    static void ALateViewerSeesWhatAnEarlyOneDoes()
    {
        using (var session = new Session())
        using (var early = new Viewer(server, session.Id))
        using (var driver = new Driver(server, session.Id))
        {
            CutThrough(driver, session.Description.Scene.Objects[0], () => { });
            var stands = server.Pause(session.Id);
            Seen one = new Seen(), other = new Seen();
            Wait("the early viewer's last state", () => { early.Look(one.Take); return one.Step >= stands; });
            using (var late = new Viewer(server, session.Id))
            {
                Wait("the late viewer's state", () => { late.Look(other.Take); return other.Step >= stands; });
            }
            Expect(one.Hash == other.Hash && one.IsCut && other.IsCut, "they see other surfaces");
            Expect(one.ById.Count == other.ById.Count, "they see other vertices");
            var apart = one.ById.Max(entry => entry.Value.Zip(other.ById[entry.Key], (a, b) => Math.Abs(a - b)).Max());
            Expect(apart < 1e-6, "vertices are " + apart + " m apart");
        }
    }

    static void AViewerHearsOfTheEnd()
    {
        var session = new Session();
        using (var viewer = new Viewer(server, session.Id))
        {
            Wait("a first state", () => viewer.Look(_ => { }));
            session.Dispose();
            Wait("the end", () => viewer.HasEnded);
            Expect(viewer.Trouble == null, viewer.Trouble);
        }
    }

    static void NoServerIsSaidInWords()
    {
        using (var viewer = new Viewer(new Server("http://127.0.0.1:9"), "any"))
        {
            Wait("a word", () => viewer.Trouble != null && viewer.Trouble.Contains("127.0.0.1:9"));
            Expect(!viewer.HasEnded, "it does not try again");
        }
    }

    static void ASessionThatIsMadeSaysHowFarItIs()
    {
        var told = new List<MakingProgress>();
        var made = server.Create(new CreateSessionRequest { SceneName = "liver", StepRateHz = 30, StartPaused = true }, told.Add);
        server.Close(made.SessionId);
        Expect(told.Count > 1 && told.Last().Voxels > 10000, told.Count + " were told");
        Expect(told.Zip(told.Skip(1), (one, next) => one.Share <= next.Share).All(grows => grows), "it falls back");
    }

    static void AViewerAndADriverFollowASessionThatMoves(string from, string program, string elsewhere)
    {
        using (var session = new Session())
        using (var viewer = new Viewer(server, session.Id))
        using (var driver = new Driver(server, session.Id))
        {
            var box = session.Description.Scene.Objects[0];
            var touches = new Vec3 { X = 0.5f * (box.RestMinM.X + box.RestMaxM.X), Y = box.RestMaxM.Y - 0.001f, Z = 0.5f * (box.RestMinM.Z + box.RestMaxM.Z) };
            Action press = () => driver.Move(0, touches, new Quat { W = 1 });
            ulong step = 0;
            Wait("a first state", () => viewer.Look(replica => step = replica.State == null ? 0 : replica.State.Step) && step > 0);
            press();
            var command = "session --server " + from + " move " + session.Id + " " + elsewhere;
            using (var move = Process.Start(new ProcessStartInfo(program, command) { UseShellExecute = false }))
            {
                move.WaitForExit();
                Expect(move.ExitCode == 0, "the session does not move");
            }
            var there = new Server(elsewhere);
            var before = there.Describe(session.Id).Step;
            Wait("states of the other server", () => { press(); viewer.Look(replica => step = replica.State == null ? 0 : replica.State.Step); return step > before + 10; });
            Wait("all to be well", () => { press(); return viewer.Trouble == null && driver.Trouble == null; });
            there.Close(viewer.Server.Describe(session.Id).SessionId);
            Wait("the end", () => viewer.HasEnded);
        }
    }

    /// <summary>What a viewer saw last, by the vertices' ids.</summary>
    sealed class Seen
    {
        public ulong Step, Hash;
        public bool IsCut;
        public readonly Dictionary<uint, float[]> ById = new Dictionary<uint, float[]>();

        public void Take(Replica replica)
        {
            if (replica.State == null) return;
            var body = replica.Bodies[0];
            Expect(replica.Hash() == replica.StatedHash, "the surface is not the server's");
            Step = replica.State.Step;
            Hash = replica.Hash();
            IsCut = Enumerable.Range(0, body.QuadCount).Any(body.IsCutFace);
            var positions = new float[3 * body.VertexCount];
            body.Positions(positions);
            for (var i = 0; i < body.VertexCount; i++) ById[body.IdOf(i)] = new[] { positions[3 * i], positions[3 * i + 1], positions[3 * i + 2] };
        }
    }

    /// <summary>Takes the first tool down through the middle of an object, in a second and a half.</summary>
    static void CutThrough(Driver driver, ObjectSummary box, Action between)
    {
        var clock = Stopwatch.StartNew();
        const double lastsS = 1.5;
        float top = box.RestMaxM.Y + 0.005f, bottom = box.RestMinM.Y;
        while (clock.Elapsed.TotalSeconds < lastsS)
        {
            var share = (float)(clock.Elapsed.TotalSeconds / lastsS);
            var at = new Vec3
            {
                X = 0.5f * (box.RestMinM.X + box.RestMaxM.X),
                Y = top + share * (bottom - top),
                Z = 0.5f * (box.RestMinM.Z + box.RestMaxM.Z),
            };
            driver.Move(0, at, new Quat { W = 1 });
            between();
            Thread.Sleep(5);
        }
    }

    static void ExpectInside(float[] at, ObjectSummary box, float marginM)
    {
        var inside = at[0] > box.RestMinM.X - marginM && at[0] < box.RestMaxM.X + marginM
            && at[1] > box.RestMinM.Y - marginM && at[1] < box.RestMaxM.Y + marginM
            && at[2] > box.RestMinM.Z - marginM && at[2] < box.RestMaxM.Z + marginM;
        Expect(inside, "a vertex is outside of its object");
    }

    static void ATokenOverTlsLetsIn(string address, string token, string certificateFile)
    {
        Expect(new Server(address, token, certificateFile).ListScenes().Count > 0, "no scenes");
        ExpectRefused(StatusCode.Unauthenticated, () => new Server(address, "wrong", certificateFile).ListScenes());
        ExpectRefused(StatusCode.Unavailable, () => new Server(address, token).ListScenes());
    }

    /// <summary>Lines of run.sh: the file of the authority, the address of a server, and what the refusal says; nothing where there is none.</summary>
    static void AnAuthorityVouchesForServersOfItsNamesAlone(string token, string cases)
    {
        foreach (var line in File.ReadAllLines(cases))
        {
            var parts = line.Split(new[] { ' ' }, 3);
            Action call = () => Expect(new Server(parts[1], token, parts[0]).ListScenes().Count > 0, "no scenes");
            if (parts[2].Length == 0) call();
            else
            {
                // A server whose certificate were taken would never answer: it speaks TLS alone.
                var refused = System.Threading.Tasks.Task.Run(() => ExpectRefused(StatusCode.Unavailable, call, parts[2]));
                Expect(refused.Wait(TimeSpan.FromSeconds(10)), "taken: " + line);
            }
            Console.WriteLine("ok AnAuthorityVouchesForServersOfItsNamesAlone " + line);
        }
    }

    static void ExpectRefused(StatusCode code, Action act, string words = "")
    {
        try
        {
            act();
        }
        catch (KerfException error)
        {
            Expect(error.Code == code && error.Message.Contains(words), error.Code + ": " + error.Message);
            return;
        }
        throw new Exception("not refused as " + code);
    }

    sealed class Session : IDisposable
    {
        public readonly SessionDescription Description = server.Create(new CreateSessionRequest { SceneName = "cuboid", StepRateHz = 60 });
        public string Id => Description.SessionId;

        public void Dispose()
        {
            try
            {
                server.Close(Id);
            }
            catch (KerfException error) when (error.Code == StatusCode.NotFound)
            {
                // Ended already, here or elsewhere.
            }
        }
    }

    static void Wait(string what, Func<bool> until)
    {
        var clock = Stopwatch.StartNew();
        while (!until())
        {
            Expect(clock.Elapsed.TotalSeconds < 20, "waited in vain for " + what);
            Thread.Sleep(5);
        }
    }

    static void Expect(bool holds, string otherwise)
    {
        if (!holds) throw new Exception(otherwise);
    }
}
