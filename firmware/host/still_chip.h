// SPDX-License-Identifier: Apache-2.0
// A chip that is not there: the registers of an MPU-9250 or ICM-20648 behind SPI, with readings that are set by hand.
#pragma once

#include "../node/node.h"
#include "../node/port.h"

#include <array>
#include <cstddef>
#include <cstdint>

namespace sinew {

class StillChip final : public Spi {
public:
    // who_am_i: kMpu9250, kIcm20648, or another for no chip at all.
    StillChip(Clock& clock, uint8_t who_am_i)
        : clock_(clock), who_am_i_(who_am_i), period_us_(period()), next_us_(clock.micros()) {}

    Sample sample{{-1, 253, 300}, {16384, -1000, 2000}};  // FF FF FD 00 at first: rates that need stuffing
    // As a fault, no sample gets ready any more.
    bool is_frozen = false;

    // The byte of a register, by bank and place.
    uint8_t at(uint8_t bank, uint8_t place) const { return banks_[bank & 3][place & 0x7F]; }
    uint32_t next_us() const { return next_us_; }

    void exchange(uint8_t* bytes, size_t size) override {
        const uint8_t place = bytes[0] & 0x7F;
        if (bytes[0] & 0x80) {
            if (is_mpu() || is_icm())
                for (size_t at = 1; at < size; ++at) bytes[at] = read(static_cast<uint8_t>(place + at - 1));
            else
                for (size_t at = 1; at < size; ++at) bytes[at] = 0xFF;
        } else if (is_icm() && place == 0x7F) {
            bank_ = bytes[1] >> 4 & 3;
        } else {
            banks_[bank_][place] = bytes[1];
        }
    }

private:
    bool is_mpu() const { return who_am_i_ == kMpu9250; }
    bool is_icm() const { return who_am_i_ == kIcm20648; }
    uint32_t period() const { return is_icm() ? 889 : 1000; }

    uint8_t read(uint8_t place) {
        if (is_mpu() ? place == 0x75 : bank_ == 0 && place == 0x00) return who_am_i_;
        if (is_mpu() ? place == 0x3A : bank_ == 0 && place == 0x1A) return ready();
        const uint8_t first = is_mpu() ? 0x3B : 0x2D, gyro = static_cast<uint8_t>(first + (is_mpu() ? 8 : 6));
        if (place >= first && place < first + 6) return half(sample.acceleration, static_cast<uint8_t>(place - first));
        if (place >= gyro && place < gyro + 6) return half(sample.gyro, static_cast<uint8_t>(place - gyro));
        return banks_[bank_][place];
    }

    uint8_t ready() {
        const uint32_t now = clock_.micros();
        if (is_frozen || static_cast<int32_t>(now - next_us_) < 0) return 0;
        next_us_ = now - (now - next_us_) % period_us_ + period_us_;
        return 1;
    }

    static uint8_t half(const std::array<int16_t, 3>& axes, uint8_t place) {
        const auto count = static_cast<uint16_t>(axes[place / 2]);
        return static_cast<uint8_t>(place % 2 ? count : count >> 8);
    }

    Clock& clock_;
    uint8_t who_am_i_;
    uint32_t period_us_;
    uint32_t next_us_;
    uint8_t bank_ = 0;
    std::array<std::array<uint8_t, 128>, 4> banks_{};
};

}  // namespace sinew
