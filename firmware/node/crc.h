// SPDX-License-Identifier: Apache-2.0
// The CRC of Protocol 2.0: polynomial 0x8005, start 0, nothing reflected or inverted.
#pragma once

#include <cstddef>
#include <cstdint>

namespace sinew {

// The CRC after so many bits more, all 0.
constexpr uint16_t crc_shifted(unsigned crc, int bits) {
    return static_cast<uint16_t>(bits == 0 ? crc
                                           : crc_shifted((crc << 1 ^ (crc & 0x8000 ? 0x8005 : 0)) & 0xFFFF, bits - 1));
}
constexpr uint16_t crc_of_nibble(unsigned nibble) { return crc_shifted(nibble << 12, 4); }

constexpr uint16_t kCrcOfNibble[] = {
    crc_of_nibble(0), crc_of_nibble(1), crc_of_nibble(2), crc_of_nibble(3), crc_of_nibble(4), crc_of_nibble(5),
    crc_of_nibble(6), crc_of_nibble(7), crc_of_nibble(8), crc_of_nibble(9), crc_of_nibble(10), crc_of_nibble(11),
    crc_of_nibble(12), crc_of_nibble(13), crc_of_nibble(14), crc_of_nibble(15),
};

inline uint16_t crc_step(uint16_t crc, uint8_t byte) {
    crc = static_cast<uint16_t>(crc << 4 ^ kCrcOfNibble[crc >> 12 ^ byte >> 4]);
    return static_cast<uint16_t>(crc << 4 ^ kCrcOfNibble[crc >> 12 ^ (byte & 0xF)]);
}

inline uint16_t crc16(const uint8_t* bytes, size_t size, uint16_t crc = 0) {
    for (size_t at = 0; at < size; ++at) crc = crc_step(crc, bytes[at]);
    return crc;
}

}  // namespace sinew
