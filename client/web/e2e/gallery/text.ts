// The words of docs/explanation/gallery.md.

interface Entry {
  figure: number;
  title: string;
  /** What is seen; what is ours, and what differs from the paper. */
  seen: string;
  ours: string;
  /** Scene, what is other in it, and what its tools do. */
  scene: string;
}

const ENTRIES: readonly Entry[] = [
  {
    figure: 2,
    title: "A liver and what it is made of",
    seen: `The surface; the composite elements that move it, through it; the voxels, with the edges of the elements
around them. Every voxel belongs to one element of 4 x 4 x 4.`,
    ours: `The shape is ours (two lobes of the paper's size), since the paper's mesh was not published. The paper's
voxels are orange. Ours are coloured by the elastic energy of their element. The liver stores energy where it stands on
the table, where it lies on its pad, and where its ends are pulled apart.`,
    scene: "`liver` after 20 ms.",
  },
  {
    figure: 4,
    title: "Energy while a cuboid is cut",
    seen: `Above, a blade presses a block until the tissue ruptures, and then cuts it. Below is the elastic energy of each
element at the same steps. It is largest under the edge. Behind the edge the walls of the cut are relaxed (blue).`,
    ours: `The colours go by the root of the energy per volume. The block is drawn apart by 30 kPa on two of its sides,
a fiftieth of E, so that the cut stands open; the paper's is not. Elements of 2 voxels a side (the scene: 8) show more of
the field.`,
    scene: "`cuboid` at 250 Hz with `level = 1` and the two tractions; the blade goes down 40 mm over the front side.",
  },
  {
    figure: 9,
    title: "With and without fracture and adaptation",
    seen: `A blade on its way into jelly, at the same three depths in each row. Above it cuts whatever it meets, as in
cutting by geometry alone. In the middle the cut waits for its energy, so the jelly dents first; but the surface follows
the elements, which are coarser than the edge. Below it also lies on the blade. The last column is the third from nearby.`,
    ours: `The first row is the same method with hardly any fracture energy, not another program. The middle row is the
third drawn as the elements have it ("Not adapted" in the viewer): forces and cuts do not depend on the adaptation, so
these are one session. The paper uses another model.`,
    scene: "`jelly` at 500 Hz, the first row with `fracture_energy_j_per_m2 = 1`; the blade goes down 25 mm at 50 mm/s.",
  },
  {
    figure: 12,
    title: "Three materials",
    seen: `Jelly dents deepest before it ruptures, rubber least, tofu between them. The curves are the force on the blade
over its depth; they drop where the material ruptures.`,
    ours: `The order is the paper's, from which our fracture energies were taken; the paper states neither energies nor
forces. Each material's steady force is its fracture energy times the length of the edge in it, which grows in a dome.`,
    scene: "`jelly`, `tofu` and `rubber` at 500 Hz; the blade goes down 30 mm at 50 mm/s.",
  },
  {
    figure: 13,
    title: "Blades of other shapes",
    seen: `A blade whose edge is a fold line, and one whose edge is a wave. The dent has the shape of the edge, and so
has the cut, which the last column shows without the blade. The second row of each is nearer and from higher up.`,
    ours: `The paper does not say how large its folds and waves are; ours go 10 mm to either side. The block is drawn
apart by 50 kPa on its front and back so that the cut stands open, and has elements of 4 voxels a side (the scene: 8).`,
    scene: "`cuboid-polyline` and `cuboid-sine` at 250 Hz with `level = 2` and the two tractions; the blade goes down 35 mm.",
  },
  {
    figure: 14,
    title: "A hepatectomy",
    seen: `A grasper holds the tip of the left lobe taut; a blade cuts the tip off, and the grasper takes it away with
the lesion (pale) in it. The arrows are the forces on the tools.`,
    ours: `The paper's lesion is black. Ours lies within the lobe in the scene, and is moved here to where it can be
seen: \`center_m = [0.075, 0.158, 0.057]\`, \`radius_m = 0.014\`.`,
    scene: "`hepatectomy` at 500 Hz, with the strokes of `hepatectomy.csv`.",
  },
  {
    figure: 15,
    title: "Other models, cut at will",
    seen: `A gummy bear loses an ear, an apple a slice, a cucumber its end. Cut faces have a colour of their own. Each
is shown with the blade halfway, and when a grasper has taken away the severed piece.`,
    ours: `The gummy bear is the paper's in size and material. Its horse, armadillo and bunny are meshes of others that
do not come with this program; any closed mesh does (\`shape = { mesh = ... }\`). Apple and cucumber are built-in
materials in a ball and a capsule.`,
    scene: "`gummy-bear`, `apple` and `cucumber` at 500 Hz, the last two in the shapes of `e2e/gallery/models.ts`.",
  },
];

export function galleryText(): string {
  const section = ({ figure, title, seen, ours, scene }: Entry) => `## Fig. ${figure}: ${title.toLowerCase()}

![${title}](gallery-fig${figure}.jpg)

${seen}

*Ours:* ${ours}

*Scene:* ${scene} \`make figures FIGURE=${figure}\`
`;
  return `<!-- Written by \`make figures\`: its text is in client/web/e2e/gallery/text.ts. -->
# Gallery

These are the figures of "Versatile cutting fracture evolution modeling for deformable object cutting simulation" (He et
al., 2022), computed by Kerf. Sessions are stepped in lock-step, so a figure is the same each time. The web viewer draws
them in a browser without a graphics card. \`make figures\` makes them all. The built-in scenes are in
\`server/scenes/builtin/\`; the strokes are in \`client/web/e2e/gallery/figures.browser.ts\`. Depths are of the edge,
below the top of the object at rest.

${ENTRIES.map(section).join("\n")}`;
}
