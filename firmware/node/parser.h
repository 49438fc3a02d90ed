// SPDX-License-Identifier: Apache-2.0
// Packets in a stream of bytes, whatever has happened to it on the way.
//
// A packet is believed if header, length, stuffing and CRC agree. Stuffing keeps the header out of every packet but a
// fast status; so a header in the midst of one proves that broken, and the parser goes over to the new one at once.
// No byte is looked at twice, and no byte takes longer than another.
#pragma once

#include "register_page.h"

#include <array>
#include <cstddef>
#include <cstdint>

namespace sinew {

enum class Heard { kNothing, kInstruction, kStatus, kFastStatus };

class Parser {
public:
    // Takes the next byte; returns what it completes. The packet stands until the next call.
    Heard feed(uint8_t byte);
    // Forgets what was begun.
    void reset();
    // While set, a header inside a fast status is taken for data.
    void follow_fast(bool follow) { follow_fast_ = follow; }

    uint8_t id() const { return id_; }
    // Instruction, or kStatus.
    uint8_t code() const { return body_[0]; }
    // Without stuffing, of an instruction.
    const uint8_t* params() const { return body_.data() + 1; }
    size_t param_count() const { return body_size_ - 1; }

    // Of a fast status that is being heard: its bytes so far from the header on, 0 where none is; what it claims to have
    // behind LEN; the CRC over its bytes; whether the last two of them are the CRC of those before.
    size_t fast_bytes() const;
    uint16_t length() const { return length_; }
    uint16_t crc() const { return crc_[0]; }
    bool ends_with_crc() const;

private:
    void begin();
    Heard take(uint8_t byte);
    Heard finish();
    bool is_fast() const { return position_ > kCode && id_ == kBroadcast && body_[0] == kStatus; }

    static constexpr size_t kIdPlace = 4, kLengthPlace = 5, kCode = 7;

    uint32_t recent_ = 0;           // the last four bytes of the stream, the newest lowest
    size_t position_ = 0;           // bytes of the packet so far, its header included; 0: none
    uint8_t id_ = 0;
    uint16_t length_ = 0;
    std::array<uint16_t, 3> crc_{};  // over all bytes so far, all but the last, all but the last two
    size_t body_size_ = 0;
    uint32_t pattern_ = 0;          // the last three bytes of the body as sent
    bool expects_stuffing_ = false;
    bool follow_fast_ = false;
    std::array<uint8_t, kLongest> body_{};
};

}  // namespace sinew
