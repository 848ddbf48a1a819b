using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.IO;
using System.Linq;
using Google.Protobuf;
using Kerf.Client;
using Kerf.V1;

/// <summary>Streams that were changed: they are refused in words or shown. Ends with 0 where all are. Those of the folder that is
/// named first are replayed, as every client does; the others are changed at random, for FUZZ_SECONDS each.</summary>
static class FuzzTest
{
    /// <summary>Longest that a stream of the folder may take, s, on a busy machine; they take milliseconds.</summary>
    const double PatienceS = 20;
    /// <summary>Most that there may be after a message, bytes: more than as many nodes as one message carries take.</summary>
    const long Memory = 512 << 20;

    static int Main(string[] arguments)
    {
        foreach (var path in Directory.GetFiles(arguments[0], "*.bin").OrderBy(path => path, StringComparer.Ordinal))
            AStreamOfTheCorpusIsRefusedInWordsOrShown(path);
        Console.WriteLine("ok AStreamOfTheCorpusIsRefusedInWordsOrShown");
        foreach (var stream in arguments.Skip(1)) AChangedStreamIsRefusedInWordsOrShown(stream);
        return 0;
    }

    static void AStreamOfTheCorpusIsRefusedInWordsOrShown(string path)
    {
        var clock = Stopwatch.StartNew();
        Show(Messages(path), path, out _, out var refused);
        Expect(refused == 0 || !path.EndsWith("sound.bin"), path + " is refused");
        Expect(clock.Elapsed.TotalSeconds < PatienceS, path + " took " + clock.Elapsed);
    }

    /// <summary>One message of a stream is changed at random; what follows meets what it has left.</summary>
    static void AChangedStreamIsRefusedInWordsOrShown(string path)
    {
        var messages = Messages(path);
        var seconds = double.Parse(Environment.GetEnvironmentVariable("FUZZ_SECONDS") ?? "2", CultureInfo.InvariantCulture);
        var seed = int.Parse(Environment.GetEnvironmentVariable("FUZZ_SEED") ?? "1", CultureInfo.InvariantCulture);
        int applied = 0, refused = 0;
        for (var clock = Stopwatch.StartNew(); clock.Elapsed.TotalSeconds < seconds; seed++)
        {
            var random = new Random(seed);
            var stream = messages.ToList();
            var target = random.Next(stream.Count);
            stream[target] = Changed(stream[target], random);
            Show(stream, "FUZZ_SEED=" + seed, out var taken, out var not);
            applied += taken;
            refused += not;
        }
        Expect(applied > 0 && refused > 0, applied + " applied, " + refused + " refused");
        Console.WriteLine("ok AChangedStreamIsRefusedInWordsOrShown " + Path.GetFileName(path));
    }

    static List<byte[]> Messages(string path)
    {
        var bytes = File.ReadAllBytes(path);
        var messages = new List<byte[]>();
        for (var at = 0; at < bytes.Length; at += 4 + messages.Last().Length)
            messages.Add(bytes.Skip(at + 4).Take(BitConverter.ToInt32(bytes, at)).ToArray());
        return messages;
    }

    /// <summary>What a viewer does with a stream.</summary>
    static void Show(IReadOnlyList<byte[]> messages, string stream, out int applied, out int refused)
    {
        applied = refused = 0;
        var assembler = new Assembler();
        var replica = new Replica();
        for (var index = 0; index < messages.Count; index++)
        {
            try
            {
                var whole = assembler.Take(ViewResponse.Parser.ParseFrom(messages[index]));
                if (whole != null && replica.Take(whole))
                    foreach (var body in replica.Bodies) body.Positions(new float[3 * body.VertexCount]);
                applied++;
            }
            catch (Exception error) when (error is MalformedException || error is InvalidProtocolBufferException)
            {
                refused++;
            }
            catch (Exception error)
            {
                throw new Exception(stream + ", message " + index, error);
            }
            var taken = GC.GetTotalMemory(false);
            Expect(taken < Memory, stream + ", message " + index + ": " + taken + " bytes are taken");
        }
    }

    static byte[] Changed(byte[] message, Random random)
    {
        var data = new List<byte>(message);
        for (var changes = random.Next(5); changes > 0 && data.Count > 0; changes--)
        {
            var at = random.Next(data.Count);
            var kind = random.Next(4);
            if (kind == 0) data[at] ^= (byte)(1 << random.Next(8));
            if (kind == 1) data.RemoveRange(at, Math.Min(data.Count - at, 1 + random.Next(16)));
            if (kind == 2) data.InsertRange(at, new byte[] { 0xff, 0xff, 0xff, 0x7f });
            if (kind == 3) data.InsertRange(at, data.Skip(at).Take(random.Next(16)).ToArray());
        }
        return data.ToArray();
    }

    static void Expect(bool holds, string otherwise)
    {
        if (!holds) throw new Exception(otherwise);
    }
}
