"""Readies the protobuf runtime's C# sources for mono's compiler, in place.

The compiler loses aliases between the parts of a class and its library keeps the class Unsafe to itself. What is changed is
slower and means the same; Unity uses the runtime as it is published.
"""

import re
import sys
from pathlib import Path

SHIM = """
namespace Google.Protobuf
{
    internal static unsafe class Unsafe
    {
        public static T ReadUnaligned<T>(ref byte source)
        {
            fixed (byte* at = &source)
            {
                object value = typeof(T) == typeof(float) ? (object)*(float*)at : *(double*)at;
                return (T)value;
            }
        }

        public static void WriteUnaligned(ref byte destination, float value)
        {
            fixed (byte* at = &destination) *(float*)at = value;
        }
    }
}
"""

PLAIN_ASCII = """private static void WriteAsciiStringToBuffer(Span<byte> buffer, ref WriterInternalState state, string value, int length)
        {
            for (var i = 0; i < length; i++) buffer[state.position++] = (byte)value[i];
        }
"""


def main(sources: Path) -> None:
    descriptor = sources / "Reflection/Descriptor.cs"
    text = descriptor.read_text()
    for alias in re.findall(r"^using (\w+) = (global::[\w.]+);", text, re.MULTILINE):
        text = re.sub(rf"\b{alias[0]}::", f"{alias[1]}.", text)
    descriptor.write_text(text)

    writing = sources / "WritingPrimitives.cs"
    text = writing.read_text()
    begin = text.index("private static void WriteAsciiStringToBuffer")
    narrow = text.index("private static void NarrowFourUtf16CharsToAsciiAndWriteToBuffer")
    end = text.index("\n        }\n", narrow) + len("\n        }\n")
    writing.write_text(text[:begin] + PLAIN_ASCII + text[end:])
    (sources / "Unsafe.cs").write_text(SHIM)


main(Path(sys.argv[1]))
