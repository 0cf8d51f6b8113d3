in vec3 seen_normal;
in vec3 seen_colour;

layout(location = 0) out vec4 normal_and_face;  // on the side that is seen; 0 where there is none
layout(location = 1) out vec4 colour_and_u;
#ifdef NUMBERED
in vec2 seen_uv;
layout(location = 2) out vec4 v;
#endif

void main()
{
    float length_of_normal = length(seen_normal);
    float scale = length_of_normal > 0.0 ? 1.0 / length_of_normal : 0.0;
    normal_and_face = vec4((gl_FrontFacing ? scale : -scale) * seen_normal, 1.0);
    colour_and_u = vec4(seen_colour, 0.0);
#ifdef NUMBERED
    normal_and_face.w = float(gl_PrimitiveID + 1);
    colour_and_u.w = seen_uv.x;
    v = vec4(seen_uv.y);
#endif
}
