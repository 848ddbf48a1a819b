using Google.Protobuf;

namespace Kerf.Client
{
    /// <summary>Integers in bytes fields, as view.proto has them: zigzag, groups of seven bits, zeros counted.</summary>
    public static class Integers
    {
        /// <summary>Reads into the front of an array. Returns how many there were.</summary>
        /// <exception cref="MalformedException">The bytes are no integers, or more than there is room for.</exception>
        public static int Read(string field, ByteString bytes, long[] into)
        {
            int at = 0, count = 0;
            while (at < bytes.Length)
            {
                var value = Group(field, bytes, ref at);
                // A zero is followed by the number of further ones.
                var run = value == 0 ? Group(field, bytes, ref at) + 1 : 1;
                if (run == 0 || run > (ulong)(into.Length - count)) throw new MalformedException(field, "at most " + into.Length + " integers");
                var integer = (long)(value >> 1) ^ -(long)(value & 1);
                for (var end = count + (int)run; count < end; count++) into[count] = integer;
            }
            return count;
        }

        static ulong Group(string field, ByteString bytes, ref int at)
        {
            ulong value = 0;
            for (var shift = 0; shift < 64; shift += 7)
            {
                if (at == bytes.Length) throw new MalformedException(field, "whole integers");
                var group = bytes[at++];
                value |= (ulong)(group & 0x7f) << shift;
                if (group < 0x80) return value;
            }
            throw new MalformedException(field, "integers of 64 bits");
        }
    }
}
