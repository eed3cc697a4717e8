//! Colours that everyone can tell apart and that survive a grey printer.

/// Red, green, blue.
pub(super) type Colour = (u8, u8, u8);

/// Text and axes.
pub(super) const INK: Colour = (27, 31, 36);
/// What stands back: guides, captions.
pub(super) const MUTED: Colour = (91, 102, 112);
/// Grid lines.
pub(super) const GRID: Colour = (226, 230, 234);
/// The paper under every picture.
pub(super) const PAPER: Colour = (255, 255, 255);
/// What passed.
pub(super) const PASS: Colour = (0, 114, 178);
/// What failed.
pub(super) const FAIL: Colour = (196, 60, 0);

/// Colours of series, in order: those of Okabe and Ito (2008) that are dark enough for thin lines, and three more.
pub(super) const SERIES: [Colour; 10] = [
    (0, 114, 178),
    (213, 94, 0),
    (0, 148, 110),
    (183, 88, 145),
    (60, 60, 60),
    (158, 116, 0),
    (66, 140, 196),
    (122, 32, 90),
    (96, 96, 168),
    (120, 82, 48),
];

/// Nine steps from compressed (blue) through unstrained (grey) to stretched (orange), all readable on paper. The ends
/// differ in lightness towards the middle by the same amount, so the sign is lost in grey print but the size is not.
pub(super) const DIVERGING: [Colour; 9] = [
    (8, 64, 129),
    (33, 102, 172),
    (67, 137, 196),
    (122, 164, 194),
    (160, 164, 168),
    (206, 152, 98),
    (214, 119, 34),
    (179, 84, 6),
    (127, 52, 8),
];

/// Classes of cells: the first is the harmless one, and lies back; the others keep apart in lightness too.
pub(super) const CLASSES: [Colour; 8] = [
    (223, 238, 246),
    (60, 60, 60),
    (196, 60, 0),
    (146, 84, 160),
    (240, 190, 70),
    (0, 148, 110),
    (228, 138, 112),
    (150, 190, 150),
];

/// As CSS writes it.
pub(super) fn css((red, green, blue): Colour) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}
