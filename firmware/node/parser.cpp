// SPDX-License-Identifier: Apache-2.0
#include "parser.h"

#include "crc.h"

namespace sinew {
namespace {

constexpr uint8_t kHeaderBytes[] = {0xFF, 0xFF, 0xFD, 0x00};
constexpr uint32_t kHeader = 0xFFFFFD00;
constexpr uint32_t kStuffed = 0xFFFFFD;
constexpr uint8_t kStuffing = 0xFD;

}  // namespace

void Parser::reset() {
    recent_ = 0;
    position_ = 0;
    follow_fast_ = false;
}

Heard Parser::feed(uint8_t byte) {
    recent_ = recent_ << 8 | byte;
    Heard heard = Heard::kNothing;
    if (position_ > 0) {
        heard = take(byte);
        if (heard != Heard::kNothing) {
            recent_ = 0;
            return heard;
        }
    }
    const bool is_data = follow_fast_ && is_fast() && position_ > 0;
    if (recent_ == kHeader && !is_data) begin();
    return heard;
}

void Parser::begin() {
    position_ = 4;
    crc_[0] = crc16(kHeaderBytes, sizeof kHeaderBytes);
    body_size_ = 0;
    pattern_ = 0;
    expects_stuffing_ = false;
}

Heard Parser::take(uint8_t byte) {
    crc_ = {crc_step(crc_[0], byte), crc_[0], crc_[1]};
    const size_t place = position_++;
    if (place == kIdPlace) {
        id_ = byte;
        if (byte > kHighestId && byte != kBroadcast) position_ = 0;
        return Heard::kNothing;
    }
    if (place == kLengthPlace) {
        length_ = byte;
        return Heard::kNothing;
    }
    if (place == kLengthPlace + 1) {
        length_ = static_cast<uint16_t>(length_ | byte << 8);
        if (length_ < 3 || length_ > kLongest) position_ = 0;
        return Heard::kNothing;
    }
    const size_t stop = kCode + length_;
    if (place + 2 >= stop) return place + 1 == stop ? finish() : Heard::kNothing;
    if (place > kCode && is_fast()) return Heard::kNothing;
    if (expects_stuffing_) {
        expects_stuffing_ = false;
        pattern_ = 0;
        if (byte != kStuffing) position_ = 0;
        return Heard::kNothing;
    }
    pattern_ = (pattern_ << 8 | byte) & 0xFFFFFF;
    body_[body_size_++] = byte;
    if (place == kCode) {
        const uint16_t shortest = byte != kStatus ? 3 : id_ == kBroadcast ? 5 : 4;
        if (length_ < shortest) position_ = 0;
    }
    expects_stuffing_ = pattern_ == kStuffed && !is_fast();
    return Heard::kNothing;
}

Heard Parser::finish() {
    const bool is_good = ends_with_crc() && !expects_stuffing_;
    const bool was_fast = is_fast();
    position_ = 0;
    if (!is_good) return Heard::kNothing;
    if (was_fast) return Heard::kFastStatus;
    return body_[0] == kStatus ? Heard::kStatus : Heard::kInstruction;
}

size_t Parser::fast_bytes() const { return is_fast() ? position_ : 0; }

bool Parser::ends_with_crc() const {
    // The bytes of a CRC, the low one first, run through the CRC of what is before them.
    const uint8_t low = static_cast<uint8_t>(crc_[2]), high = static_cast<uint8_t>(crc_[2] >> 8);
    return crc_[0] == crc_step(crc_step(crc_[2], low), high);
}

}  // namespace sinew
