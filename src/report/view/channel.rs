//! Whole numbers that change little from frame to frame, in few bytes.
//!
//! Every value is predicted from the frames before, as the last one (order 1) or along the line through the last two (order 2),
//! and only what remains is kept, modulo 2⁸ or 2¹⁶, folded so that small remainders of both signs are small numbers
//! (0, −1, 1, −2, … become 0, 1, 2, 3, …). Two bytes are kept apart, as a plane of low and one of high bytes: of a smooth motion the
//! high ones are nearly all zero, and compress to nothing.

use serde::Serialize;

/// Where a channel lies among the bytes and how to undo the prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) struct Channel {
    offset: usize,
    order: usize,
    wide: bool,
}

/// Appends the values of `count` items, frame after frame; `wide` ones have two bytes.
pub(super) fn append(bytes: &mut Vec<u8>, values: &[i32], count: usize, wide: bool) -> Channel {
    let size = |order| remainders(values, count, order, wide).map(|rest| u64::from(16 - rest.leading_zeros())).sum();
    let order = [1, 2].into_iter().min_by_key(|&order| -> u64 { size(order) }).unwrap_or(1);
    let offset = bytes.len();
    bytes.extend(remainders(values, count, order, wide).map(|rest| rest as u8));
    if wide {
        bytes.extend(remainders(values, count, order, wide).map(|rest| (rest >> 8) as u8));
    }
    Channel { offset, order, wide }
}

fn remainders(values: &[i32], count: usize, order: usize, wide: bool) -> impl Iterator<Item = u16> + '_ {
    let before = move |i: usize, frames: usize| i.checked_sub(frames * count).and_then(|at| values.get(at)).copied();
    values.iter().enumerate().map(move |(i, &value)| {
        let guess = match (before(i, 1), before(i, 2)) {
            (Some(last), Some(earlier)) if order == 2 => 2 * last - earlier,
            (Some(last), _) => last,
            (None, _) => 0,
        };
        let rest = value - guess;
        if wide {
            let rest = rest as i16;
            ((rest << 1) ^ (rest >> 15)) as u16
        } else {
            let rest = rest as i8;
            u16::from(((rest << 1) ^ (rest >> 7)) as u8)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::append;

    /// As the page does it.
    fn restore(bytes: &[u8], channel: super::Channel, frames: usize, count: usize) -> Vec<i32> {
        let plane = frames * count;
        let mut values = vec![0i32; plane];
        for i in 0..plane {
            let low = i32::from(bytes[channel.offset + i]);
            let high = if channel.wide { i32::from(bytes[channel.offset + plane + i]) } else { 0 };
            let folded = low | high << 8;
            let rest = folded >> 1 ^ -(folded & 1);
            let guess = match i / count {
                0 => 0,
                frame if frame == 1 || channel.order == 1 => values[i - count],
                _ => 2 * values[i - count] - values[i - 2 * count],
            };
            values[i] = if channel.wide { i32::from((guess + rest) as u16) } else { i32::from((guess + rest) as i8) };
        }
        values
    }

    #[test]
    fn values_come_back_whatever_they_are() {
        let [frames, count] = [7, 5];
        let wide: Vec<i32> = (0..35).map(|i: i32| i * i * 7919 % 65536).collect();
        let narrow: Vec<i32> = (0..35).map(|i: i32| i * i * 31 % 255 - 127).collect();
        let edges: Vec<i32> = (0..35).map(|i| if i % 3 == 0 { 0 } else { 65535 }).collect();
        let mut bytes = vec![1, 2, 3];
        for (values, is_wide) in [(&wide, true), (&narrow, false), (&edges, true)] {
            let channel = append(&mut bytes, values, count, is_wide);
            assert_eq!(&restore(&bytes, channel, frames, count), values);
        }
    }

    /// Uniform motion costs nothing after its second frame.
    #[test]
    fn straight_motion_leaves_no_remainder() {
        let values: Vec<i32> = (0..10).flat_map(|frame| [100 + 300 * frame, 60_000 - 700 * frame]).collect();
        let mut bytes = Vec::new();
        assert_eq!(append(&mut bytes, &values, 2, true).order, 2);
        assert!(bytes[4..20].iter().chain(&bytes[24..]).all(|&byte| byte == 0), "{bytes:?}");
    }
}
