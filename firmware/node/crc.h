// SPDX-License-Identifier: Apache-2.0
// The CRC of Protocol 2.0: polynomial 0x8005, start 0, nothing reflected or inverted.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace sinew {

constexpr std::array<uint16_t, 256> crc_table() {
    std::array<uint16_t, 256> table{};
    for (unsigned byte = 0; byte < 256; ++byte) {
        uint16_t crc = static_cast<uint16_t>(byte << 8);
        for (int bit = 0; bit < 8; ++bit)
            crc = static_cast<uint16_t>((crc & 0x8000) ? (crc << 1) ^ 0x8005 : crc << 1);
        table[byte] = crc;
    }
    return table;
}

inline constexpr std::array<uint16_t, 256> kCrcTable = crc_table();

constexpr uint16_t crc_step(uint16_t crc, uint8_t byte) {
    return static_cast<uint16_t>(crc << 8) ^ kCrcTable[(crc >> 8) ^ byte];
}

inline uint16_t crc16(const uint8_t* bytes, size_t size, uint16_t crc = 0) {
    for (size_t at = 0; at < size; ++at) crc = crc_step(crc, bytes[at]);
    return crc;
}

}  // namespace sinew
