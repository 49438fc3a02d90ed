// SPDX-License-Identifier: Apache-2.0
// A status as it goes on the wire: header, id, length, stuffed body, CRC.
#pragma once

#include "crc.h"
#include "register_page.h"

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace sinew {

class Frame {
public:
    // bytes: room for a whole status.
    Frame(uint8_t* bytes, uint8_t id) : bytes_(bytes) {
        const uint8_t head[] = {0xFF, 0xFF, 0xFD, 0x00, id, 0, 0, kStatus};
        std::memcpy(bytes_, head, sizeof head);
        size_ = sizeof head;
    }
    void add(uint8_t byte) {
        bytes_[size_++] = byte;
        pattern_ = (pattern_ << 8 | byte) & 0xFFFFFF;
        if (pattern_ == 0xFFFFFD) bytes_[size_++] = 0xFD;
    }
    // Returns how many bytes it has.
    size_t finish() {
        const size_t length = size_ - 5;
        bytes_[5] = static_cast<uint8_t>(length);
        bytes_[6] = static_cast<uint8_t>(length >> 8);
        const uint16_t crc = crc16(bytes_, size_);
        bytes_[size_++] = static_cast<uint8_t>(crc);
        bytes_[size_++] = static_cast<uint8_t>(crc >> 8);
        return size_;
    }

private:
    uint8_t* bytes_;
    size_t size_;
    uint32_t pattern_ = kStatus;
};

}  // namespace sinew
